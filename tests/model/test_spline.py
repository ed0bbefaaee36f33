"""The smooth law through measured points: against SciPy's splines, and what it refuses."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_smoothing_spline

import hbbogie as hb
from hbbogie.model import Spline

U = np.array([-3.0, -2.0, -1.2, -0.3, 0.4, 1.0, 2.5, 3.0])
FORCES = np.tanh(2 * U) + 0.1 * U**2
INSIDE = np.r_[np.linspace(-2.99, 2.99, 41), U[1:-1]]


def derivatives(law, at):
    x = ca.SX.sym("x")
    f = [law.force(x)]
    for _ in range(2):
        f.append(ca.jacobian(f[-1], x))
    return [np.asarray(y).ravel() for y in ca.Function("f", [x], f).map(len(at))(at)]


@pytest.mark.parametrize("smoothing", [0.0, 0.02])
def test_value_and_two_derivatives_are_those_of_the_spline(smoothing):
    """IDENTITY: the natural cubic spline of SciPy."""
    known = make_smoothing_spline(U, FORCES, lam=smoothing) if smoothing else CubicSpline(U, FORCES, bc_type="natural")
    found = derivatives(Spline(U.tolist(), FORCES.tolist(), smoothing), INSIDE)
    for order, values in enumerate(found):
        np.testing.assert_allclose(values, known.derivative(order)(INSIDE) if order else known(INSIDE), atol=1e-12)


def test_passes_through_its_points_and_goes_on_in_straight_lines():
    law = Spline(U.tolist(), FORCES.tolist())
    np.testing.assert_allclose([float(law.force(u)) for u in U], FORCES, atol=1e-13)
    for end, out in ((U[0], -1.0), (U[-1], 1.0)):
        value, slope, bend = derivatives(law, end + out * np.array([1e-9, 1.0, 50.0]))
        np.testing.assert_allclose(np.diff(value), slope[0] * out * np.array([1.0, 49.0]), rtol=1e-8)
        np.testing.assert_allclose(bend, 0, atol=1e-12)


def test_an_odd_table_makes_an_odd_system():
    x = hb.Coordinate("x", "m")
    u = np.linspace(-2, 2, 9)
    table = hb.Element("table", Spline(u.tolist(), (u**3).tolist(), smoothing=1e-3), x)
    assert hb.System("odd", [x], [], [x.ddot + table], [table]).odd


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (((0, 1, 2), (0, 1, 2)), "at least 5"),
        ((range(6), range(5)), "6 abscissae and 5 forces"),
        (((0, 1, 1, 2, 3), range(5)), "must increase"),
        ((range(5), (0, 1, np.nan, 3, 4)), "finite"),
        ((range(5), range(5), -1.0), "smoothing=-1"),
        (("01234", range(5)), "list of numbers"),
    ],
)
def test_wrong_points(given, said):
    with pytest.raises(hb.ModelError, match=said):
        Spline(*given)
