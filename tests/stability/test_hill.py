"""Hill's method against closed forms and against the integrated multipliers; health that knows when it fails."""

from __future__ import annotations

import numpy as np
import pytest
from known_cycles import lure, radial

from hbbogie import Coordinate, HarmonicBalance, Orbit, Parameter, System, find_cycles, fourier, load_problem, solve
from hbbogie.errors import ModelError
from hbbogie.motion import last_orbit, settle
from hbbogie.stability import floquet, hill


@pytest.fixture(scope="module")
def van_der_pol() -> System:
    return load_problem("van_der_pol").van_der_pol()


@pytest.mark.parametrize("rho", [0.01, 0.1, 0.5])
def test_radial_normal_form(rho: float) -> None:
    system, orbit = radial(rho)
    result = hill(system, orbit, harmonics=4)
    assert result.verdict == "stable" and result.unstable == 0
    assert result.multipliers[1].real == pytest.approx(np.exp(-4 * np.pi * rho), rel=1e-9)
    assert np.sort(result.exponents.real) == pytest.approx([-2 * rho, 0.0], abs=1e-12)


@pytest.mark.parametrize("builder", ["van_der_pol", "van_der_pol_first_order"])
def test_van_der_pol(builder: str) -> None:
    system = getattr(load_problem("van_der_pol"), builder)()
    orbit = find_cycles(system, mu=1.0, harmonics=31, stability=False)[0]
    result = hill(system, orbit)
    assert result.verdict == "stable" and max(result.health.values()) < 1e-9
    # the published multiplier is printed to 10 digits
    assert result.multipliers[1].real == pytest.approx(8.596950636e-4, rel=1e-8)


def test_convergence_is_spectral_for_smooth_forces(van_der_pol: System) -> None:
    """Each four harmonics more gain at least a factor of ten, and the health follows."""
    orbit = find_cycles(van_der_pol, mu=1.0, harmonics=31, stability=False)[0]
    results = [hill(van_der_pol, orbit, harmonics=H) for H in (7, 11, 15, 19)]
    errors = np.array([abs(r.multipliers[1] / 8.596950636e-4 - 1) for r in results])
    copies = np.array([r.health["copies"] for r in results])
    assert (errors[1:] < errors[:-1] / 10).all()
    assert (copies[1:] < copies[:-1] / 10).all()


def test_strongly_contracting_exponents_are_resolved(van_der_pol: System) -> None:
    """mu = 5: the multiplier 7.7e-38 is far below round-off of a monodromy matrix, its exponent is not."""
    motion = settle(van_der_pol, {"x": 1.0}, step=2e-3, mu=5.0).trajectory
    orbit = solve(HarmonicBalance(81).equations(van_der_pol), last_orbit(van_der_pol, motion, 81), mu=5.0)
    result = hill(van_der_pol, orbit)
    assert result.verdict == "stable"
    exact = np.log(7.73855508685936e-38)
    error = abs(result.exponents[1].real * orbit.period / exact - 1)
    assert error < 1.1 * result.health["determinant"] < 1e-3  # all but the trivial exponent make the determinant


def test_hill_agrees_with_floquet_for_the_bogie() -> None:
    """Of kinked forces the harmonics fall off slowly; the copies tell the error within a small factor."""
    system = load_problem("yang1995").bogie()
    unstable, stable = find_cycles(system, V=90.0, stability=False)
    better = solve(HarmonicBalance(45).equations(system), unstable)
    judged = floquet(system, better).critical
    assert judged is not None
    for H, verdict in ((5, "unknown"), (9, "unknown"), (15, "unstable")):
        result = hill(system, unstable, harmonics=H)
        error = abs(result.multipliers[0] - judged)
        assert result.verdict == verdict
        assert error < 5 * max(result.health["copies"], result.health["trivial"])
    assert error < 1e-2 * abs(judged) and result.unstable == 1
    quiet = hill(system, stable)
    assert quiet.verdict == "stable" and max(quiet.health.values()) < 1e-2
    assert np.abs(quiet.multipliers[1]) == pytest.approx(np.abs(floquet(system, stable).multipliers[1]), rel=1e-3)


def test_mixed_order_and_a_negative_multiplier() -> None:
    """At a period doubling the exponents at -1/2 and +1/2 of the frequency are one."""
    system, orbit = lure()
    result = hill(system, orbit)
    judged = floquet(system, orbit)
    assert np.sort(result.multipliers.real) == pytest.approx(np.sort(judged.multipliers.real), abs=1e-6)
    assert result.verdict == "unknown" and "unit circle" in result.reason
    assert max(result.health.values()) < 1e-9


def test_brusselator() -> None:
    x, y, B = Coordinate("x"), Coordinate("y"), Parameter("B", 3.0)
    system = System("Brusselator", [x, y], [B], [x.dot - 1 + (B + 1) * x - x**2 * y, y.dot - B * x + x**2 * y])
    coarse = find_cycles(system, B=3.0, harmonics=15, stability=False)[0]
    orbit = solve(HarmonicBalance(60).equations(system), coarse)
    result = hill(system, orbit)
    assert result.multipliers[1].real == pytest.approx(2.51637580e-4, rel=1e-6)


def test_a_bad_orbit_is_not_judged(van_der_pol: System) -> None:
    orbit = find_cycles(van_der_pol, mu=1.0, harmonics=31, stability=False)[0]
    rough = orbit.replace(coefficients=fourier.resize(orbit.coefficients, 3))
    result = hill(van_der_pol, rough, harmonics=31)
    assert result.verdict == "unknown" and "trivial" in result.reason
    assert result.health["determinant"] < 1e-9  # it judges the method alone


def test_a_constant_state_matrix() -> None:
    """Of a linear oscillator all disturbances are neutral."""
    x = Coordinate("x")
    system = System("linear", [x], [], [x.ddot + x])
    orbit = Orbit(system.name, ("x",), ("",), np.array([[0.0], [1.0], [0.0]]), 1.0, {})
    result = hill(system, orbit)
    assert result.verdict == "unknown" and np.abs(result.multipliers - 1).max() < 1e-9


def test_wrong_input_is_refused(van_der_pol: System) -> None:
    system, orbit = radial(0.1)
    with pytest.raises(ModelError, match="belongs to"):
        hill(van_der_pol, orbit)
    with pytest.raises(ModelError, match="equilibrium"):
        hill(system, orbit.replace(coefficients=np.zeros((1, 2)), omega=0.0))
    with pytest.raises(ModelError, match="harmonics"):
        hill(system, orbit, harmonics=0)
    with pytest.raises(ModelError, match="tolerance"):
        hill(system, orbit, tolerance=0.0)
