"""Describing functions of laws with several inputs against closed forms, and as equations of a cycle."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import crossings
from hbbogie.methods import DescribingFunction, describing_function, first_harmonics
from hbbogie.model import Saturation
from hbbogie.railway import LinearKalker, ShenHedrickElkins, VermeulenJohnson

F11, F22, LIMIT = 9.4e6, 8.7e6, 16.4e3  # N
SHE = ShenHedrickElkins(F11, F22, LIMIT)


def test_linear_law_is_its_coefficients():
    """IDENTITY: each input keeps its amplitude and its phase."""
    xi, eta = 1e-3 - 2e-3j, -3e-4 + 1e-4j
    np.testing.assert_allclose(
        first_harmonics(LinearKalker(F11, F22).force, xi, eta), [-F11 * xi, -F22 * eta], rtol=1e-12
    )


def test_cubic_law_in_two_inputs():
    """F = x^2 y: the mean of three products of cosines, (2 x conj(x) y + x x conj(y)) / 4."""
    x, y = 0.3 - 0.4j, 1.1 + 0.7j
    (found,) = first_harmonics(lambda x, y: x**2 * y, x, y)
    assert found == pytest.approx((2 * abs(x) ** 2 * y + x**2 * y.conjugate()) / 4, rel=1e-12)


@pytest.mark.parametrize("U", [0.3, 1.0, 2.9])
def test_creepage_along_one_direction(U):
    """1 - u/3 + u^2/27 over u = U cos: 1 - (8/9 pi) U + U^2/36, also where both creepages are in phase."""
    gain = 1 - 8 * U / (9 * np.pi) + U**2 / 36
    angle = 0.6
    xi, eta = U * LIMIT * np.cos(angle) / F11, U * LIMIT * np.sin(angle) / F22
    np.testing.assert_allclose(first_harmonics(SHE.force, xi, eta), [-F11 * xi * gain, -F22 * eta * gain], rtol=1e-8)


@pytest.mark.parametrize(("U", "e"), [(0.5, 1 - 0.5 / 3 + 0.25 / 27), (3.0, 1 / 3), (10.0, 0.1)])
def test_creepages_of_one_size_a_quarter_of_a_period_apart(U, e):
    """The linear force turns with constant size, so that the reduction is that of the law itself."""
    xi, eta = U * LIMIT / F11, 1j * U * LIMIT / F22
    np.testing.assert_allclose(first_harmonics(SHE.force, xi, eta), [-F11 * e * xi, -F22 * e * eta], rtol=1e-9)


def test_saturation_along_one_direction_has_its_known_describing_function():
    law = Saturation(2.0, 1.0)
    force = ca.Function("f", [u := ca.SX.sym("u")], [law.force(u)])
    for Y in (0.3, 0.8, 5.0):
        (found,) = first_harmonics(lambda u: np.asarray(force(u.reshape(1, -1))).ravel(), Y)
        assert found == pytest.approx(Y * describing_function(law, Y), rel=1e-8)


def test_wrong_input():
    with pytest.raises(hb.ModelError, match=r"depends on xi, eta.*first_harmonics"):
        describing_function(SHE, 1e-3)
    with pytest.raises(hb.ModelError, match="cannot be evaluated with 1 input"):
        first_harmonics(SHE.force, 1e-3)
    for wrong in ((np.nan, 0.0), ("a", 0.0), ()):
        with pytest.raises(hb.ModelError, match="finite amplitudes"):
            first_harmonics(SHE.force, *wrong)
    with pytest.raises(hb.ModelError, match="forces are not finite"):
        first_harmonics(lambda u: np.nan * u, 1.0)


def test_quasi_linear_cycle_of_a_bogie_balances_its_first_harmonics():
    """The creep forces of the equations are those of `first_harmonics` at the cycle's own creepages."""
    problem = hb.load_problem("kaas_petersen1986")
    system = problem.bogie()
    (hopf,) = hb.hopf_points(system, "V", (50.0, 90.0))
    equations = DescribingFunction().equations(system)
    branch = hb.trace(equations, hopf, "V", (60.0, 90.0), stability=False)
    cycle = crossings(equations, branch, 80.0)[0]
    p, w = system.values, cycle.omega
    q1, q2, q5, q6, q7 = (
        complex(*(cycle.coefficients[k, cycle.index(name)] * s for k, s in ((1, 1), (2, -1))))
        for name in ("q1", "q2", "q5", "q6", "q7")
    )
    V = 80.0
    xi = p["a"] * 1j * w * q2 / V + p["lam"] * q1 / p["r0"]
    eta = 1j * w * q1 / V - q2
    Fx, Fy = first_harmonics(VermeulenJohnson(p["C"], p["muN"]).force, xi, eta)
    flange = describing_function(problem.DeadBand(p["K0"], p["y0"]), abs(q1)) * q1
    lateral = -(w**2) * p["Mw"] * q1 + 2 * p["K1"] * (q1 - q5 - p["b"] * q6 - p["h1"] * q7) - 2 * Fy + flange
    yaw = -(w**2) * p["Iwy"] * q2 + 2 * p["K2"] * p["d1"] ** 2 * (q2 - q6) - 2 * p["a"] * Fx
    assert abs(lateral) < 1e-5 * abs(2 * Fy) and abs(yaw) < 1e-5 * abs(2 * p["a"] * Fx)
