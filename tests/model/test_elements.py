"""Laws: their forces at points known in closed form."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie.model import Ramps


def _force(law, u):
    return [float(law.force(x)) for x in u]


def test_dead_band():
    assert _force(hb.model.DeadBand(2.0, 1.0), (-3, -1, 0, 0.5, 1, 2.5)) == [-4, 0, 0, 0, 0, 3]


def test_saturation():
    assert _force(hb.model.Saturation(2.0, 1.0), (-3, -0.25, 0.5, 9)) == [-1, -0.5, 1, 1]


def test_saturation_of_a_falling_line():
    assert _force(hb.model.Saturation(-2.0, 1.0), (-3, -0.25, 0.5, 9)) == [1, 0.5, -1, -1]


@pytest.mark.parametrize("stiffness", [0, 0.0])
def test_saturation_without_stiffness_is_no_force(stiffness):
    assert _force(hb.model.Saturation(stiffness, 1.0), (-3, -0.25, 0.5, 9)) == [0, 0, 0, 0]


def test_saturation_without_stiffness_has_a_slope_in_it():
    """The derivative of clip(k u, -1, 1) with respect to k at k = 0 is u."""
    k = ca.SX.sym("k")
    slope = ca.Function("slope", [k], [ca.jacobian(hb.model.Saturation(k, 1.0).force(2.5), k)])
    assert float(slope(0.0)) == 2.5


def test_damper_with_blow_off():
    """Slope 200 kN s/m up to 6 kN, which it reaches at 0.03 m/s, and 10 kN s/m beyond; of no slope it has failed."""
    speeds = (-0.13, -0.03, 0.01, 0.03, 0.23)
    forces = _force(hb.model.Saturation(200e3, 6e3, beyond=10e3), speeds)
    np.testing.assert_allclose(forces, [-7e3, -6e3, 2e3, 6e3, 8e3])
    assert _force(hb.model.Saturation(0.0, 6e3, beyond=10e3), speeds) == [0, 0, 0, 0, 0]


def test_tabulated_passes_its_points_and_extends_beyond_them():
    law = hb.model.Tabulated((-1.0, 0.0, 2.0), (-3.0, 0.0, 1.0))
    np.testing.assert_allclose(_force(law, (-2, -1, 0, 1, 2, 4)), [-6, -3, 0, 0.5, 1, 2])


def test_cubic_and_polynomial_agree():
    u = np.linspace(-2, 2, 5)
    np.testing.assert_allclose(_force(hb.model.Cubic(3.0, 0.5), u), _force(hb.model.Polynomial((0, 0.5, 0, 3.0)), u))


def test_friction_reaches_its_limit():
    assert _force(hb.model.Friction(4.0, 1e-3), (1.0, -1.0)) == pytest.approx([4.0, -4.0], rel=1e-12)


def test_coulomb_friction_jumps():
    assert _force(hb.model.CoulombFriction(4.0), (1e-9, 0.0, -3.0)) == [4.0, 0.0, -4.0]


def test_backlash_keeps_its_force_in_the_play():
    """k = 2, half the play 1, amplitude 3: held at 4 on the way back until u = 1, then down with u + 1."""
    law = hb.model.Backlash(2.0, 1.0)
    u = np.array([3.0, 2.0, 1.0, 0.0, -3.0])
    down = law.steady_force(np.arccos(u / 3), 3.0)
    np.testing.assert_allclose(down, [4, 4, 4, 2, -4], atol=1e-12)
    np.testing.assert_allclose(law.steady_force(2 * np.pi - np.arccos(u / 3), 3.0), [4, 2, 0, -2, -4], atol=1e-12)
    np.testing.assert_allclose(law.steady_force(np.linspace(0, 6, 7), 1.0), 0)


def test_an_element_keeps_what_its_law_knows():
    x, k = hb.Coordinate("x"), hb.Parameter("k", 2.0)
    laws = (hb.model.DeadBand(k, 1.0), hb.model.Cubic(0.3, k), hb.model.Friction(k, 0.1))
    elements = [hb.Element(f"e{i}", law, x) for i, law in enumerate(laws)]
    band, cubic, friction = hb.System("s", [x], [k], [x.ddot + sum(elements)], elements).elements
    at = [e.at(np.array([2.0])) for e in (band, cubic, friction)]
    assert float(at[0].ramps().force(2.5)) == float(at[0].force(2.5)) == 3.0
    assert [float(c) for c in at[1].polynomial()] == [0, 2.0, 0, 0.3]
    assert float(at[1].describing(2.0)) == pytest.approx(2.0 + 0.75 * 0.3 * 4)
    assert float(at[0].reference_stiffness()) == 2.0
    assert at[2].ramps() is at[2].polynomial() is at[2].describing(1.0) is at[2].reference_stiffness() is None


def test_ramps_with_offset():
    assert Ramps(((1, 2.0, 1.0),), stiffness=1.0, offset=0.5).force(3.0) == 0.5 + 3.0 + 4.0


@pytest.mark.parametrize(("u", "forces"), [((0.0,), (1.0,)), ((0.0, 1.0), (1.0,)), ((1.0, 0.0), (0.0, 1.0))])
def test_wrong_tables_are_refused(u, forces):
    with pytest.raises(hb.ModelError, match="Tabulated"):
        hb.model.Tabulated(u, forces)


def test_a_law_needs_a_force():
    with pytest.raises(hb.ModelError, match="no method force"):
        hb.Element("spring", 3.0, hb.Coordinate("x"))


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (lambda m: m.DeadBand(1.0, -0.1), "DeadBand: gap is -0.1; give a finite number, 0 or more"),
        (lambda m: m.Backlash(1.0, -0.1), "Backlash: gap"),
        (lambda m: m.Saturation(1.0, -2.0), "Saturation: limit"),
        (lambda m: m.Friction(1.0, 0.0), "Friction: width is 0; give a finite number above 0"),
        (lambda m: m.DeadBand("5", 0.1), "DeadBand: stiffness: got '5'"),
        (lambda m: m.DeadBand(True, 0.1), "DeadBand: stiffness: got True"),
        (lambda m: m.Cubic(None), "Cubic: coefficient: got None"),
        (lambda m: m.Cubic(float("nan")), "Cubic: coefficient is nan"),
        (lambda m: m.Step(lambda: 1.0), "Step: height"),
        (lambda m: m.CoulombFriction([1.0]), "CoulombFriction: limit: got an object of type list"),
        (lambda m: m.Friction(ca.MX.sym("f"), 0.1), "casadi.MX cannot be used"),
        (lambda m: m.Polynomial(3.0), "Polynomial: coefficients: got 3.0; give a list"),
        (lambda m: m.Polynomial(["1"]), "Polynomial: coefficients, place 1: got '1'"),
        (lambda m: m.Tabulated("01", "01"), "Tabulated: u: got '01'"),
        (lambda m: m.Tabulated([0.0, True], [0.0, 1.0]), "Tabulated: u, place 2: got True"),
        (lambda m: m.Tabulated([0.0, ca.SX.sym("a")], [0.0, 1.0]), "abscissae must be numbers"),
    ],
)
def test_arguments_of_laws(law, said):
    with pytest.raises(hb.ModelError, match=said):
        law(hb.model)
