"""Laws that are 0/0 at rest: written with their limits, and named where they are not."""

import casadi as ca
import numpy as np
import pytest

from hbbogie import Coordinate, ModelError, Parameter, System, hopf_points
from hbbogie.model import magnitude, quotient


def slope(law, at=0.0):
    x = ca.SX.sym("x", 2)
    return ca.Function("J", [x], [ca.jacobian(law(x[0], x[1]), x)])([at, 0]).full().ravel()


def test_a_factor_of_the_magnitude_leaves_the_slope_at_rest():
    assert slope(lambda x, y: x * (2 - magnitude(x, y))).tolist() == [2.0, 0.0]
    assert slope(lambda x, y: magnitude(x, y), 3.0).tolist() == [1.0, 0.0]


def test_a_saturated_force_has_its_slope_at_rest():
    """tanh(k u) x/u, whose slope is k; away from rest along x it is k / cosh(k x)^2."""
    k = 5.0

    def force(x, y):
        u = magnitude(x, y)
        return quotient(ca.tanh(k * u), u, k) * x

    assert slope(force).tolist() == [k, 0.0]
    assert slope(force, 0.1) == pytest.approx([k / np.cosh(0.5) ** 2, 0.0], rel=1e-12)


def test_a_quotient_of_zeros_is_named():
    x = Coordinate("x", "m", "displacement")
    k = Parameter("k", 1.0, "N", "limit")
    u = ca.sqrt(x.dot**2)
    with pytest.raises(
        ModelError, match=r"equation 1 divides by .*d\(x\)/dt.*, which is 0 there\. .*quotient\("
    ) as told:
        System("slider", [x], [k], [x.ddot + x + k * ca.tanh(u) * x.dot / u])
    assert "magnitude(x, y)" in str(told.value)
    System("slider", [x], [k], [x.ddot + x + k * quotient(ca.tanh(u), u, 1) * x.dot])


def test_a_root_without_derivative_is_named_where_equilibria_are_searched():
    """The law is finite at rest, its derivative is 0/0: the evidence gives the helper."""
    x, y = Coordinate("x", "m"), Coordinate("y", "m")
    k = Parameter("k", 1.0, "N/m", "stiffness", (0.1, 10.0))
    u = k + ca.sqrt(x**2 + y**2)
    system = System("plane", [x, y], [k], [x.ddot + 0.1 * x.dot + u * x, y.ddot + 0.1 * y.dot + u * y])
    found = hopf_points(system, "k", (0.5, 2.0))
    assert any("hbbogie.model.magnitude(x, y)" in sentence for sentence in found.evidence)


@pytest.mark.parametrize("wrong", [lambda: quotient("x", 1.0, 1.0), lambda: magnitude(None)])
def test_what_is_no_expression_is_refused(wrong):
    with pytest.raises(ModelError, match="give a scalar expression"):
        wrong()
