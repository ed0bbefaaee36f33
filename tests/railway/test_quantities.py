"""Quantities of running stability and their limits, against their formulas and wrong input."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie import railway


def test_quantities_are_what_their_formulas_say():
    y, psi, Q = hb.Coordinate("y", "m"), hb.Coordinate("psi", "rad"), hb.Parameter("Q", 54.5e3, "N")
    outputs = [
        railway.frame_acceleration("over the front", y, psi, 1.28),
        railway.guiding_forces("guiding", 3e5 * y, 2e5 * y),
        railway.derailment_quotient("Y/Q", 3e5 * y, Q),
    ]
    system = hb.System("frame", [y, psi], [Q], [y.ddot + 4 * y, psi.ddot + 9 * psi], outputs=outputs)
    found = system.dynamics.measure(ca.DM([0.01, 0.02]), ca.DM.zeros(2), ca.DM([54.5e3])).full().ravel()
    np.testing.assert_allclose(found, [-0.04 - 1.28 * 0.18, 5e3, 3e3 / 54.5e3], rtol=1e-12)
    assert [system.naming.units[o] for o in system.output_names] == ["m/s2", "N", "1"]


def test_limits_have_the_values_of_their_formulas():
    """A bogie of 5 t and a wheelset load of 109 kN; Nadal's formula by hand."""
    assert railway.frame_acceleration_limit(5000.0).value == pytest.approx(5.5, rel=1e-12)
    assert railway.guiding_forces_limit(109e3).value == pytest.approx((10e3 + 109e3 / 3) / 2, rel=1e-12)
    assert railway.guiding_forces_limit(109e3, 0.85).value == pytest.approx(0.85 * (10e3 + 109e3 / 3) / 2, rel=1e-12)
    assert railway.flange_climb_limit(70.0, 0.6).value == pytest.approx(0.81, abs=0.005)
    assert railway.flange_climb_limit(45.0, 0.0).value == pytest.approx(1.0, rel=1e-12)
    assert railway.hunting_limit_fra().value == pytest.approx(2.941995, rel=1e-12)
    for limit in (railway.frame_acceleration_limit(5e3), railway.hunting_limit_fra()):
        assert "to be checked" in limit.label and limit.source


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: railway.frame_acceleration_limit(-1.0), "above 0 in kg"),
        (lambda: railway.frame_acceleration_limit(61e3), "there is no limit"),
        (lambda: railway.frame_acceleration_limit("5 t"), "above 0 in kg"),
        (lambda: railway.guiding_forces_limit(0.0), "above 0 in N"),
        (lambda: railway.guiding_forces_limit(1e5, None), "factor"),
        (lambda: railway.flange_climb_limit(95.0), "between 0 and 90"),
        (lambda: railway.flange_climb_limit(20.0, 0.5), "below its tangent"),
        (lambda: railway.guiding_forces("none"), "got no forces"),
        (lambda: railway.derailment_quotient("Y/Q", "Y", 1.0), "quotes"),
        (lambda: railway.frame_acceleration("front", "y", "psi"), "Coordinate"),
        (lambda: railway.frame_acceleration("", hb.Coordinate("y"), hb.Coordinate("psi")), "name of an output"),
    ],
)
def test_wrong_input(wrong, said):
    with pytest.raises(hb.ModelError, match=said):
        wrong()
