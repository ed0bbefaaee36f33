"""Cycles polished by multiple shooting: exact orbits, true errors, contacts, families, wrong input."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.errors import ModelError
from hbbogie.results import ConvergenceError
from hbbogie.stability import Shooting, Verification, defect, verify
from hbbogie.stability.verification import _closed

TOLERANCE = 1e-10  # asked for; ten times as much is allowed
# V [m/s], omega [rad/s], largest |q1| and |q3| [m] of exact orbits: contact times located, matrix exponentials
EXACT = (
    (90.00, 27.777184, 0.01001397, 0.00939986),
    (100.86, 31.244200, 0.01116129, 0.01061176),
    (127.81, 37.626573, 0.01531334, 0.01378380),
    (184.46, 43.487785, 0.02905325, 0.02446477),
)
UNSTABLE = (90.00, 27.043851, 0.00945603, 0.00852216)


def meets(found: Verification, row: tuple[float, ...]) -> None:
    """Assert every printed digit of an exact orbit."""
    numbers = (found.orbit.omega, found.amplitudes["q1"], found.amplitudes["q3"])
    for number, printed, digit in zip(numbers, row[1:], (1e-6, 1e-8, 1e-8), strict=True):
        assert abs(number - printed) <= 0.5001 * digit
    assert found.closure < 10 * TOLERANCE and found.trivial_error < 1e-8 and found.isolated


@pytest.fixture(scope="module")
def exact(bogie: hb.System, cycles_at_90: list[hb.Orbit]) -> Verification:
    return verify(bogie, cycles_at_90[-1])


@pytest.fixture(scope="module")
def van_der_pol() -> hb.System:
    return hb.load_problem("van_der_pol").van_der_pol()


def cycle_of_van_der_pol(system: hb.System, mu: float, H: int) -> hb.Orbit:
    guess = hb.motion.last_orbit(system, hb.motion.settle(system, {"x": 1.0}, mu=mu).trajectory, H)
    return hb.solve(hb.HarmonicBalance(H).equations(system), guess, mu=mu)


@pytest.mark.parametrize("row", EXACT)
def test_stable_cycles_of_the_bogie(bogie, balance, branch, row) -> None:
    from hbbogie.branches import crossings

    orbit = max(crossings(balance, branch, row[0]), key=lambda o: o.amplitude("q1"))
    found = verify(bogie, orbit)
    meets(found, row)
    assert found.orbit.stability.verdict == "stable" and "8 contact(s)" in found.status
    assert 0 < found.waveform_error < 1e-3 < found.defect < 0.1


def test_unstable_cycle_of_the_bogie(bogie, cycles_at_90) -> None:
    found = verify(bogie, cycles_at_90[0])
    meets(found, UNSTABLE)
    assert found.orbit.stability.verdict == "unstable" and found.orbit.stability.unstable == 1
    judged = hb.floquet(bogie, found.orbit)  # along the series, which is cut off
    assert found.multipliers[0].real == pytest.approx(judged.multipliers[0].real, abs=5 * judged.trivial_error)
    assert found.trivial_error < 1e-3 * judged.trivial_error


@pytest.mark.parametrize("H", [1, 5, 31])
def test_errors_are_the_true_errors(bogie, cycles_at_90, exact, H) -> None:
    orbit = hb.solve(hb.HarmonicBalance(H).equations(bogie), cycles_at_90[-1], V=90.0)
    found = verify(bogie, orbit)
    assert found.omega_error == pytest.approx(orbit.omega - exact.orbit.omega, rel=1e-6)
    for name in bogie.coordinate_names:
        true = orbit.amplitude(name) - exact.amplitudes[name]
        assert found.amplitude_errors[name] == pytest.approx(
            true, rel=1e-6, abs=10 * TOLERANCE * exact.amplitudes[name]
        )


def test_errors_fall_with_the_harmonics(bogie, cycles_at_90) -> None:
    found = [
        verify(bogie, hb.solve(hb.HarmonicBalance(H).equations(bogie), cycles_at_90[-1], V=90.0)) for H in (3, 9, 31)
    ]
    for name in ("waveform_error", "defect"):
        errors = [getattr(v, name) for v in found]
        assert errors[0] > errors[1] > errors[2] > 0


def test_polished_orbit_is_in_phase_and_exact(bogie, cycles_at_90, exact, tmp_path) -> None:
    t = np.linspace(0, exact.orbit.period, 64)
    phase = t / exact.orbit.period
    gap = np.abs(exact.orbit.q(t) - cycles_at_90[-1].q(phase * cycles_at_90[-1].period)).max(axis=0)
    peaks = np.array(list(exact.amplitudes.values()))
    assert (gap / peaks).max() <= exact.waveform_error * (1 + 1e-3)
    assert exact.orbit.amplitude("q1") == pytest.approx(exact.amplitudes["q1"], rel=1e-6)  # the series is cut off
    assert exact.orbit.H >= 127 and exact.orbit.parameters == cycles_at_90[-1].parameters
    exact.orbit.save(tmp_path / "exact.nc")
    again = verify(bogie, hb.Orbit.load(tmp_path / "exact.nc"))
    assert abs(again.omega_error) < 1e-9 * exact.orbit.omega and again.waveform_error < 1e-6
    assert again.defect == pytest.approx(defect(bogie, exact.orbit), rel=1e-12)


def test_order_of_contacts_is_corrected(bogie, balance, cycles_at_90) -> None:
    """With three harmonics the rear wheelset stays clear at 88.77 m/s; the true cycle touches."""
    low = hb.HarmonicBalance(3).equations(bogie)
    orbit, fine = hb.solve(low, cycles_at_90[0], V=90.0), cycles_at_90[0]
    for V in (89.5, 89.1, 88.85, 88.765):
        orbit, fine = hb.solve(low, orbit, V=V), hb.solve(hb.HarmonicBalance(9).equations(bogie), fine, V=V)
    y0 = orbit.parameters["y0"]
    found = verify(bogie, orbit)
    assert orbit.amplitude("q3") < y0 < found.amplitudes["q3"]
    assert "8 contact(s)" in found.status
    assert found.orbit.omega == pytest.approx(verify(bogie, fine).orbit.omega, rel=1e-9)


def test_functions_are_built_once(bogie, cycles_at_90) -> None:
    verify(bogie, cycles_at_90[-1])
    built = set(bogie.dynamics.once)
    verify(bogie, cycles_at_90[0])
    assert set(bogie.dynamics.once) == built


def test_van_der_pol(van_der_pol) -> None:
    published = hb.load_problem("van_der_pol").PUBLISHED[0]
    for H in (5, 15):
        found = verify(van_der_pol, cycle_of_van_der_pol(van_der_pol, 1.0, H))
        assert found.orbit.period == pytest.approx(published.period, rel=TOLERANCE)
        assert found.amplitudes["x"] == pytest.approx(published.peak, rel=TOLERANCE)
        assert found.multipliers[1].real == pytest.approx(published.multiplier, rel=1e-8)
        assert found.trivial_error < 1e-8 and found.orbit.stability.verdict == "stable"


@pytest.mark.parametrize(("row", "H"), [(1, 15), (1, 5), (2, 61)])
def test_stiff_van_der_pol(van_der_pol, row, H) -> None:
    published = hb.load_problem("van_der_pol").PUBLISHED[row]
    found = verify(van_der_pol, cycle_of_van_der_pol(van_der_pol, published.mu, H))
    assert found.orbit.period == pytest.approx(published.period, rel=TOLERANCE)
    assert found.amplitudes["x"] == pytest.approx(published.peak, rel=TOLERANCE)
    assert found.orbit.stability.verdict == "stable" and abs(found.multipliers[1]) < 1e-12


def test_first_order_form_agrees(van_der_pol) -> None:
    first = hb.load_problem("van_der_pol").van_der_pol_first_order()
    found = verify(first, cycle_of_van_der_pol(first, 1.0, 15))
    assert found.orbit.period == pytest.approx(6.66328685932313019, rel=TOLERANCE)


def test_strongly_unstable_cycle_is_held(van_der_pol) -> None:
    """Time reversed, a disturbance grows 1e37 times in a period: too much for single shooting."""
    orbit = cycle_of_van_der_pol(van_der_pol, 5.0, 15)
    c = orbit.coefficients.copy()
    c[2::2] *= -1
    found = verify(van_der_pol, orbit.replace(coefficients=c, parameters={"mu": -5.0}))
    assert found.orbit.period == pytest.approx(11.6122306677195700, rel=TOLERANCE)
    assert found.orbit.stability.verdict in ("unstable", "unknown")  # the trivial multiplier is lost in the product


def test_contacts_and_a_smooth_nonlinearity() -> None:
    """The polished orbit against a motion integrated step by step."""
    x, mu = hb.Coordinate("x"), hb.Parameter("mu", 1.0)
    stop = hb.Element("stop", hb.model.DeadBand(stiffness=20.0, gap=1.0), x)
    system = hb.System("stopped", [x], [mu], [x.ddot - mu * (1 - x**2) * x.dot + x + stop], [stop])
    settled = hb.motion.settle(system, {"x": 1.0}).trajectory
    found = verify(system, hb.motion.last_orbit(system, settled, 25))
    start = {"x": found.orbit.q(0)[0, 0], "x'": found.orbit.v(0)[0, 0]}
    after = hb.simulate(system, start, found.orbit.period, method="cvodes", step=1e-2, tolerance=1e-11)
    assert "4 contact(s)" in found.status
    assert [after.q[-1, 0], after.v[-1, 0]] == pytest.approx(list(start.values()), abs=1e-5)
    assert found.multipliers[1].real == pytest.approx(hb.floquet(system, found.orbit).multipliers[1].real, rel=1e-3)


def test_contacts_at_the_same_time() -> None:
    """Two equal stops at one place are one stop twice as stiff."""
    x = hb.Coordinate("x")
    one, two = (hb.Element(name, hb.model.DeadBand(stiffness=5.0, gap=1.0), x) for name in ("one", "two"))
    motion = x.ddot - 0.3 * (1 - x**2) * x.dot + x
    both = hb.System("stops", [x], [], [motion + one + two], [one, two])
    single = hb.System("stops", [x], [], [motion + 2 * one], [one])
    orbit = hb.motion.last_orbit(single, hb.motion.settle(single, {"x": 1.0}).trajectory, 25)
    a, b = verify(both, orbit), verify(single, orbit)
    assert "8 contact(s)" in a.status and "4 contact(s)" in b.status
    assert a.orbit.omega == pytest.approx(b.orbit.omega, rel=10 * TOLERANCE)
    assert a.multipliers == pytest.approx(b.multipliers, abs=1e-8)


@pytest.mark.parametrize(("name", "amplitude"), [("gap_oscillator", 3.0), ("duffing", 2.0)])
def test_a_continuous_family_is_reported(name, amplitude) -> None:
    problem = hb.load_problem(name)
    system = problem.SYSTEM()
    omega = problem.backbone(2.0) if name == "duffing" else 2 * np.pi / problem.period(3.0)
    c = np.zeros((19, 1))
    c[1] = amplitude
    guess = hb.Orbit(system.name, ("x",), ("m",), c, float(omega), dict(system.values))
    orbit = hb.solve(hb.HarmonicBalance(9).equations(system), guess, amplitude={"x": amplitude}, free="d")
    found = verify(system, orbit.replace(parameters=dict(system.values)))
    assert not found.isolated and "family" in found.status
    peak = found.amplitudes["x"]  # whichever member was taken, it is an exact one
    exact = problem.backbone(peak) if name == "duffing" else 2 * np.pi / problem.period(peak)
    assert found.orbit.omega == pytest.approx(float(exact), rel=10 * TOLERANCE)
    assert found.orbit.stability.verdict == "unknown"


def test_what_is_no_cycle_is_refused(bogie, cycles_at_90, van_der_pol) -> None:
    orbit = cycles_at_90[-1]
    with pytest.raises(ModelError, match="belongs to"):
        verify(van_der_pol, orbit)
    with pytest.raises(ModelError, match="equilibrium"):
        verify(bogie, orbit.replace(coefficients=orbit.coefficients[:1]))
    with pytest.raises(ModelError, match="equilibrium"):
        verify(bogie, orbit.replace(coefficients=0 * orbit.coefficients))
    with pytest.raises(ModelError, match="frequency"):
        verify(bogie, orbit.replace(omega=-1.0))
    with pytest.raises(ModelError, match="finite"):
        verify(bogie, orbit.replace(coefficients=orbit.coefficients * np.nan))
    with pytest.raises(ModelError, match="tolerance"):
        verify(bogie, orbit, tolerance=0.0)


def test_a_motion_that_shrinks_to_rest_is_no_cycle(bogie, cycles_at_90, van_der_pol) -> None:
    small = cycles_at_90[0].replace(coefficients=0.1 * cycles_at_90[0].coefficients)
    with pytest.raises(ConvergenceError, match="shrunk"):
        verify(bogie, small)
    x = hb.Coordinate("x")  # about a position of rest that is not zero
    system = hb.System("raised", [x], [], [x.ddot + 0.1 * x.dot + x - 1])
    orbit = hb.Orbit("raised", ("x",), ("",), np.array([[1.0], [0.5], [0.0]]), 1.0, {})
    with pytest.raises(ConvergenceError):
        verify(system, orbit)


def test_a_kink_that_is_not_an_element_refines_the_mesh() -> None:
    """A kink that is no element costs elements, not the answer."""
    import casadi as ca

    x = hb.Coordinate("x")
    stop = hb.Element("stop", hb.model.DeadBand(stiffness=20.0, gap=1.0), x)
    bump = 20 * (ca.fmax(x - 1, 0) - ca.fmax(-x - 1, 0))
    hidden = hb.System("hidden", [x], [], [x.ddot - (1 - x**2) * x.dot + x + bump])
    known = hb.System("known", [x], [], [x.ddot - (1 - x**2) * x.dot + x + stop], [stop])
    orbit = hb.motion.last_orbit(known, hb.motion.settle(known, {"x": 1.0}).trajectory, 25)
    assert verify(hidden, orbit).orbit.omega == pytest.approx(verify(known, orbit).orbit.omega, rel=10 * TOLERANCE)


def test_a_jump_is_not_resolved() -> None:
    import casadi as ca

    x = hb.Coordinate("x")
    system = hb.System("jumping", [x], [], [x.ddot + x + 0.2 * x.dot - 0.5 * ca.sign(x.dot)])
    orbit = hb.motion.last_orbit(system, hb.motion.settle(system, {"x": 1.0}).trajectory, 25)
    with pytest.raises(ConvergenceError):
        verify(system, orbit)


def test_determinant_of_the_bogie_by_liouville(bogie, cycles_at_90) -> None:
    """The flanges act on positions alone, so the trace of the state matrix is the same along the whole cycle."""
    shooting, path, step = _closed(bogie, cycles_at_90[-1], TOLERANCE)
    p = bogie.vector(**cycles_at_90[-1].parameters)
    exact = path.durations.sum() * np.trace(bogie.ode_jacobian(np.zeros(14), p).full())
    assert shooting.trace(path) == pytest.approx(exact, rel=1e-12)
    assert np.linalg.slogdet(step.transitions)[1].sum() == pytest.approx(exact, rel=1e-10)


def test_a_determinant_that_is_off_is_not_trusted(van_der_pol, monkeypatch) -> None:
    orbit = cycle_of_van_der_pol(van_der_pol, 1.0, 15)
    monkeypatch.setattr(Shooting, "trace", lambda shooting, path: np.log(8.7e-4))  # truth: 8.597e-4
    stability = verify(van_der_pol, orbit).orbit.stability
    assert stability.verdict == "unknown" and "Liouville" in stability.reason
