"""What harmonics leave out of a fold, against folds known exactly."""

import pytest

import hbbogie as hb
from hbbogie import Coordinate, HarmonicBalance, Parameter, System
from hbbogie.stability import fold_shift


def shifted(system, guess, parameter, exact, H):
    """Return error of a fold with H harmonics, its shift, and what the shift leaves."""
    fold = hb.fold(HarmonicBalance(H).equations(system), guess, parameter)
    shift = fold_shift(system, fold.orbit, parameter)
    assert shift.apart < 0.1
    return fold.value - exact, shift.value, fold.value + shift.value - exact


def test_with_masses_and_contacts_little_is_left():
    """Yang's bogie, whose fold is known in closed form."""
    bogie = hb.load_problem("yang1995").bogie()
    exact = hb.critical_speeds(bogie, "V", (60.0, 190.0))[0]
    for H in (5, 9, 15):
        error, _, left = shifted(bogie, exact.orbit, "V", exact.value, H)
        assert abs(left) < 0.1 * abs(error)


def test_in_smooth_equations_of_first_order_the_shift_bounds_what_is_left():
    """Bautin's fold is at mu = -a^2/4 in any coordinates, here x = u + u^2/5, in which it is not odd."""
    u, y, mu = Coordinate("u"), Coordinate("y"), Parameter("mu", -0.2)
    x = u + u**2 / 5
    r = x**2 + y**2
    growth = mu + r - r**2
    bautin = System("curved", [u, y], [mu], [u.dot - (growth * x - y) / (1 + 0.4 * u), y.dot - growth * y - x])
    (fold,) = (c for c in hb.critical_speeds(bautin, "mu", (-0.4, 0.3)) if c.kind == "fold")
    assert abs(fold.value + 0.25) <= fold.error < 1e-9
    for H in (1, 2, 3):
        error, shift, left = shifted(bautin, fold.orbit, "mu", -0.25, H)
        assert abs(error) > 1e-6 and abs(left) < 0.6 * abs(shift)


@pytest.mark.parametrize("rate", [-0.3, 0.3])
def test_whether_a_stable_cycle_begins_at_a_fold(rate):
    """A state that grows beside Bautin's oscillator has the multiplier exp(2 pi rate), whatever the oscillator does."""
    x, y, z, mu = Coordinate("x"), Coordinate("y"), Coordinate("z"), Parameter("mu", -0.2)
    r = x**2 + y**2
    growth = mu + r - r**2
    equations = [x.dot - growth * x + y, y.dot - growth * y - x, z.dot - rate * z]
    found = hb.critical_speeds(System("beside", [x, y, z], [mu], equations), "mu", (-0.4, 0.3))
    (fold,) = (c for c in found if c.kind == "fold")
    assert fold.value == pytest.approx(-0.25, abs=1e-9)
    assert ("the cycles next to it are all unstable" in fold.status) == (rate > 0)


def test_where_angles_run_on_there_is_none():
    bautin = hb.load_problem("bautin").bautin()
    (hopf,) = hb.hopf_points(bautin, "mu", (-0.1, 0.1))
    assert fold_shift(bautin, hopf.orbit.replace(advance=(6.28, 0.0)), "mu") is None
