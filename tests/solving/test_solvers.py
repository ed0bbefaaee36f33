"""Solving: given parameter, given amplitude, Newton and IPOPT alike; failures that explain themselves."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import ConvergenceError, ModelError


@pytest.fixture(scope="module")
def guess(branch):
    return branch.orbits[-8]


@pytest.mark.parametrize("method", ["newton", "ipopt"])
def test_exact_orbits_of_the_bogie(balance, guess, method):
    """PUBLISHED: exact periodic orbits (contact times located, closed to 1e-12); H = 15 is good to 3e-4."""
    for V, omega, a1, a3 in (
        (100.86, 31.244200, 0.01116129, 0.01061176),
        (127.81, 37.626573, 0.01531334, 0.01378380),
    ):
        orbit = hb.solve(balance, guess, method=method, V=V)
        assert orbit.omega == pytest.approx(omega, rel=2e-5)
        assert orbit.amplitude("q1") == pytest.approx(a1, rel=3e-4)
        assert orbit.amplitude("q3") == pytest.approx(a3, rel=3e-4)
        assert orbit.parameters["V"] == V


def test_newton_and_ipopt_agree(balance, guess):
    a, b = (hb.solve(balance, guess, method=m, V=150.0) for m in ("newton", "ipopt"))
    np.testing.assert_allclose(a.coefficients, b.coefficients, atol=1e-11)


@pytest.mark.parametrize("method", ["newton", "ipopt"])
def test_given_amplitude_finds_the_speed(balance, guess, method):
    orbit = hb.solve(balance, guess, amplitude={"q1": 0.0180}, free="V", method=method)
    assert orbit.first_harmonic("q1") == pytest.approx(0.0180, rel=1e-9)
    back = hb.solve(balance, orbit, V=orbit.parameters["V"])
    assert back.omega == pytest.approx(orbit.omega, rel=1e-9)


def test_amplitude_of_a_condensed_coordinate(balance, guess):
    target = 1.01 * guess.first_harmonic("q6")
    orbit = hb.solve(balance, guess, amplitude={"q6": target}, free="V")
    assert orbit.first_harmonic("q6") == pytest.approx(target, rel=1e-9)


def test_any_parameter_may_be_free(balance, guess):
    """The cycle does not move when the conicity found for its amplitude is put back."""
    V, amplitude = guess.parameters["V"], {"q1": 1.02 * guess.first_harmonic("q1")}
    orbit = hb.solve(balance, guess, amplitude=amplitude, free="lam", V=V)
    again = hb.solve(balance, orbit, V=V, lam=orbit.parameters["lam"])
    assert again.omega == pytest.approx(orbit.omega, rel=1e-9)


def test_more_harmonics_from_fewer(bogie, guess):
    fine = hb.HarmonicBalance(31).equations(bogie)
    V = guess.parameters["V"]
    assert hb.solve(fine, guess, V=V).omega == pytest.approx(guess.omega, rel=2e-5)


def test_solutions_satisfy_the_equations_of_motion(bogie, balance, guess):
    """Every equation, also those that eliminated coordinates, at the harmonics kept."""
    orbit = hb.solve(balance, guess, V=120.0)
    full = hb.HarmonicBalance(15, condense=False).equations(bogie)
    F = full.residual(full.encode(orbit), bogie.vector(V=120.0)).full().ravel()
    assert np.abs(F / full.residual_scale).max() < 1e-10


def test_the_solver_is_built_once(balance, guess):
    hb.solve(balance, guess, method="ipopt", V=120.0)
    before = set(balance.once)
    hb.solve(balance, guess, method="ipopt", V=121.0)
    assert set(balance.once) == before


class TestFailures:
    def test_below_the_fold_there_is_no_cycle(self, balance, guess):
        with pytest.raises(ConvergenceError, match="What to try") as caught:
            hb.solve(balance, guess, V=80.0)
        error = caught.value
        assert error.orbit is not None and error.orbit.parameters["V"] == 80.0
        assert "equation of" in error.statistics["worst"] and "harmonic" in error.statistics["worst"]
        assert error.statistics["residual"] > 1e-10 or error.statistics["active_bounds"]

    def test_equilibrium_as_guess(self, balance, guess):
        flat = guess.replace(coefficients=0 * guess.coefficients)
        with pytest.raises(ModelError, match="does not move in 'q1'"):
            hb.solve(balance, flat, V=100.0)

    def test_orbit_of_another_system(self, balance):
        other = hb.find_cycles(hb.load_problem("bautin").bautin(), mu=-0.1, stability=False)[0]
        with pytest.raises(ModelError, match="the guess is an orbit of"):
            hb.solve(balance, other)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"W0": 1.0}, "unknown parameter 'W0'"),
            ({"V": -3.0}, "allowed is a finite number from 1 to 400 m/s"),
            ({"method": "simplex"}, "unknown method"),
            ({"free": "V"}, "give both"),
            ({"amplitude": {"q9": 0.01}, "free": "V"}, "unknown coordinate"),
            ({"amplitude": {"q1": -0.01}, "free": "V"}, "positive number"),
            ({"amplitude": {"q1": 0.01}, "free": "V", "V": 90.0}, "both free and fixed"),
            ({"amplitude": {"q1": 0.01, "q3": 0.01}, "free": "V"}, "one coordinate"),
        ],
    )
    def test_conditions_that_do_not_fit(self, balance, guess, arguments, message):
        with pytest.raises(ModelError, match=message):
            hb.solve(balance, guess, **arguments)
