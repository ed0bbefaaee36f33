"""Multipliers measured in time agree with Floquet theory and with closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from known_cycles import lure, radial

import hbbogie as hb
from hbbogie.attraction import measure_attraction

CLOSE = 1e-2  # what a user is promised


def shipped(name, **values):
    module = hb.load_problem(name)
    return module, getattr(module, name)(**values)


@pytest.mark.parametrize(("which", "verdict"), [(0, "repels"), (1, "attracts")])
def test_both_cycles_of_the_bogie(bogie, which, verdict):
    cycle = hb.find_cycles(bogie, V=90.0)[which]
    found = measure_attraction(bogie, cycle)
    assert found.verdict == verdict == {"stable": "attracts", "unstable": "repels"}[cycle.stability.verdict]
    moduli = np.abs(np.delete(cycle.stability.multipliers, np.argmin(np.abs(cycle.stability.multipliers - 1))))
    assert abs(found.predicted) == pytest.approx(moduli.max(), rel=1e-5)
    assert found.difference == pytest.approx(abs(found.measured - found.predicted) / abs(found.predicted))
    assert found.difference < CLOSE and found.scatter < CLOSE


@pytest.mark.parametrize("which", [0, 1])
def test_bautin_against_the_closed_form(which):
    """The multiplier is exp(T f'(r)), r' = f(r)."""
    module, system = shipped("bautin")
    cycle = hb.find_cycles(system, mu=-0.1)[which]
    exact = float(module.multiplier(module.radii(-0.1)[which]))
    found = measure_attraction(system, cycle)
    assert found.measured == pytest.approx(exact, rel=CLOSE)
    assert found.verdict == ("repels" if exact > 1 else "attracts")


@pytest.mark.parametrize("rho", [0.01, 0.1])
def test_radial_against_the_closed_form(rho):
    system, cycle = radial(rho)
    found = measure_attraction(system, cycle)
    assert found.measured == pytest.approx(np.exp(-4 * np.pi * rho), rel=CLOSE)
    assert len(found.shares) > 3 and found.shares[0] == 1


def test_error_falls_with_the_square_of_the_disturbance():
    """The difference of two motions on either side has no term of second order."""
    system, cycle = radial(0.05)
    exact, sizes = np.exp(-0.2 * np.pi), np.array([0.2, 0.1, 0.05])
    errors = [abs(measure_attraction(system, cycle, disturbance=size, polish=False).measured - exact) for size in sizes]
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 1.7 < slope < 2.3


def test_van_der_pol_against_the_published_multiplier():
    module, system = shipped("van_der_pol", mu=1.0)
    (cycle,) = hb.find_cycles(system, mu=1.0)
    found = measure_attraction(system, cycle)
    assert found.measured == pytest.approx(module.PUBLISHED[0].multiplier, rel=CLOSE)
    assert found.verdict == "attracts" and "Floquet theory says" in found.status


def test_time_reversed_van_der_pol_repels():
    """The cycle of mu = -1/2 is that of mu = 1/2 run through backwards: the multiplier is the inverse."""
    _, system = shipped("van_der_pol")
    (cycle,) = hb.find_cycles(system, mu=0.5)
    mirrored = cycle.coefficients.copy()
    mirrored[2::2] *= -1
    reversed_cycle = cycle.replace(coefficients=mirrored, parameters={"mu": -0.5})
    forwards, backwards = (measure_attraction(system, c) for c in (cycle, reversed_cycle))
    assert backwards.verdict == "repels"
    assert forwards.measured * backwards.measured == pytest.approx(1, rel=2 * CLOSE)


def test_a_decay_too_fast_is_not_measured():
    _, system = shipped("van_der_pol", mu=5.0)
    (cycle,) = hb.find_cycles(system, mu=5.0)
    found = measure_attraction(system, cycle)
    assert np.isnan(found.measured) and np.isnan(found.difference) and found.verdict == "unknown"
    assert "too fast to be measured" in found.status


def test_wrong_input(bogie, cycles_at_90):
    system, cycle = radial(0.1)
    with pytest.raises(hb.ModelError, match="disturbance"):
        measure_attraction(system, cycle, disturbance=0.0)
    with pytest.raises(hb.ModelError, match="belongs to"):
        measure_attraction(system, cycles_at_90[0])
    with pytest.raises(hb.ModelError, match="equilibrium"):
        measure_attraction(system, cycle.replace(coefficients=np.zeros((1, 2)), omega=0.0))


def test_negative_multiplier():
    """Lur'e beyond its period doubling: the disturbance changes its side from one period to the next."""
    system, orbit = lure()
    system = system.with_parameters(alpha=0.64)
    cycle = hb.solve(hb.HarmonicBalance(25).equations(system), orbit)
    found = hb.attraction.measure_attraction(system, cycle)
    assert found.predicted.real < -0.9 and found.verdict == "attracts"
    assert found.measured == pytest.approx(found.predicted, rel=1e-3)


def test_jumps_are_part_of_the_prediction():
    """Published multiplier 0.00243051."""
    system = hb.load_problem("piecewise").piecewise()
    (cycle,) = hb.find_cycles(system)
    found = hb.attraction.measure_attraction(system, cycle)
    assert found.predicted.real == pytest.approx(0.00243051, rel=5e-3)
