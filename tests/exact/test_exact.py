"""Exact cycles of systems that are linear between switchings: the model, single cycles, multipliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import hbbogie as hb
from hbbogie import fourier
from hbbogie.errors import ModelError
from hbbogie.exact import (
    cycle_of,
    exact_cycle,
    sequence_passed,
    settled,
    stabilities,
    switched_linear,
)
from hbbogie.model import CoulombFriction, DeadBand, Saturation, Tabulated


def oscillator(law, argument: str = "velocity", negative: float = 0.2, **laws) -> hb.System:
    """A mass on a spring with negative damping and one more force, of its velocity or of its position."""
    x, c = hb.Coordinate("x", "m"), hb.Parameter("c", negative)
    element = hb.Element("law", law, x.dot if argument == "velocity" else x)
    return hb.System("oscillator", [x], [c], [x.ddot - c * x.dot + x + element], [element])


def guess(system: hb.System, amplitude: float, omega: float = 1.0, H: int = 1, mean: float = 0.0) -> hb.Orbit:
    """The harmonic motion of that amplitude, or the harmonic balance near it."""
    c = np.array([[mean], [amplitude], [0.0]])
    orbit = hb.Orbit(system.name, ("x",), ("m",), c, omega, dict(system.values))
    return hb.solve(hb.HarmonicBalance(H).equations(system), orbit)


SELF_EXCITED = {
    "saturation": (lambda: oscillator(Saturation(-1.0, 0.4), negative=-0.3), 1.0),
    "dead band": (lambda: oscillator(DeadBand(1.0, 1.0)), 1.2),
    "table": (lambda: oscillator(Tabulated([-2.0, -1.0, 0.5, 2.0], [-1.5, -0.2, 0.0, 1.0])), 1.4),
    "stop beside a gap": (
        lambda: oscillator(Tabulated([-1.0, 1.0, 1.3], [0.0, 0.0, 0.6]), negative=0.1),
        1.4,
    ),
    "Coulomb friction": (lambda: oscillator(CoulombFriction(0.1), negative=0.1), 1.27),
}


@pytest.mark.parametrize("name", SELF_EXCITED)
def test_cycle_is_that_of_shooting(name):
    build, amplitude = SELF_EXCITED[name]
    system = build()
    orbit = guess(system, amplitude, H=15)
    truth = hb.verify(system, orbit)
    point = exact_cycle(system, orbit, "c")
    cycle = cycle_of(point)
    assert cycle.omega == pytest.approx(truth.orbit.omega, rel=1e-10)
    assert cycle.amplitude("x") == pytest.approx(truth.amplitudes["x"], rel=1e-9)
    (stability,) = stabilities(point.closing, point.y[None], point.at)
    assert stability.verdict == truth.orbit.stability.verdict
    exact, other = (np.sort(np.abs(s.multipliers)) for s in (stability, truth.orbit.stability))
    assert exact == pytest.approx(other, rel=1e-8, abs=1e-10)


def test_free_mass_between_springs_has_the_period_in_closed_form():
    module = hb.load_problem("gap_oscillator")
    system = module.gap_oscillator()
    for amplitude in (1.5, 2.5, 4.0):
        c = np.zeros((3, 1))
        c[1] = amplitude
        orbit = hb.Orbit(system.name, ("x",), ("m",), c, 2 * np.pi / module.period(amplitude), dict(system.values))
        cycle = cycle_of(exact_cycle(system, orbit, "d", free=True))
        assert abs(cycle.parameters["d"]) < 1e-12
        assert cycle.period == pytest.approx(float(module.period(cycle.amplitude("x"))), rel=1e-12)


def test_coulomb_friction_holds_a_cycle_of_known_size():
    # x'' - c x' + F sign(x') + x = 0: with k = exp(c pi / (2 w)) a swing from -A ends at A = k^2 (A - F) - F ... = A
    limit, c = 0.1, 0.1
    system = oscillator(CoulombFriction(limit), negative=c)
    cycle = cycle_of(exact_cycle(system, guess(system, 4 * limit / (np.pi * c), H=15), "c"))
    w = np.sqrt(1 - c**2 / 4)
    growth = np.exp(c * np.pi / (2 * w))
    assert cycle.amplitude("x") == pytest.approx(limit * (growth + 1) / (growth - 1), rel=1e-12)
    assert cycle.omega == pytest.approx(w, rel=1e-12)


def test_relay_oscillation_of_three_lags():
    # y = 1/(s + 1)^3 u with u = -sign(y): half a period h from C (I + exp(A h))^-1 A^-1 (exp(A h) - I) B = 0
    names = [hb.Coordinate(f"y{i}") for i in range(3)]
    gain = hb.Parameter("gain", 1.0)
    relay = hb.Element("relay", CoulombFriction(gain), names[2])
    rates = [-names[0] - relay, names[0] - names[1], names[1] - names[2]]
    system = hb.System("relay", names, [gain], [y.dot - r for y, r in zip(names, rates, strict=True)], [relay])
    A = np.array([[-1.0, 0, 0], [1, -1, 0], [0, 1, -1]])

    def residual(h: float) -> float:
        E = expm(A * h)
        return float((np.linalg.solve(np.eye(3) + E, np.linalg.solve(A, (E - np.eye(3)) @ [1.0, 0, 0])))[2])

    half = brentq(residual, 1.0, 3.0, xtol=1e-14)
    c = np.zeros((3, 3))
    c[1:, 2] = 0.15, 0.0
    c[1:, 1], c[1:, 0] = (0.15, -0.25), (-0.3, -0.5)
    orbit = hb.Orbit(system.name, system.coordinate_names, ("",) * 3, c, np.sqrt(3), dict(system.values))
    cycle = cycle_of(exact_cycle(system, orbit, "gain"))
    assert cycle.period == pytest.approx(2 * half, rel=1e-12)
    assert cycle.motion.sigma == -1


def test_harmonic_balance_tends_to_it(bogie, cycles_at_90):
    unstable = cycles_at_90[0]
    exact = cycle_of(exact_cycle(bogie, unstable, "V"))
    errors = []
    for H in (5, 15, 45):
        orbit = hb.solve(hb.HarmonicBalance(H).equations(bogie), unstable)
        errors.append(abs(orbit.omega - exact.omega))
    # a kink in the force: coefficients fall as H^-4, the frequency at least as fast
    assert errors[1] < errors[0] * 3**-3 and errors[2] < errors[1] * 3**-3


def test_bogie_at_90(bogie, cycles_at_90):
    for orbit in cycles_at_90:
        point = exact_cycle(bogie, orbit, "V")
        cycle, truth = cycle_of(point), hb.verify(bogie, orbit)
        assert cycle.omega == pytest.approx(truth.orbit.omega, rel=1e-11)
        for name in bogie.coordinate_names:
            assert cycle.amplitude(name) == pytest.approx(truth.amplitudes[name], rel=1e-9)
        (stability,) = stabilities(point.closing, point.y[None], point.at)
        assert stability.verdict == truth.orbit.stability.verdict
        assert stability.trivial_error < 1e-10
        c = cycle.harmonics(15)
        size = np.hypot(c[1::2], c[2::2])
        other = truth.orbit.coefficients[:31]
        assert size == pytest.approx(np.hypot(other[1::2], other[2::2]), abs=1e-11)


def test_quantities_of_an_exact_cycle(bogie, cycles_at_90):
    cycle = cycle_of(exact_cycle(bogie, cycles_at_90[-1], "V"))
    t = np.linspace(0, cycle.period, 4097)[:-1]
    q = cycle.q(t)
    low, high = cycle.extremes
    assert (q <= high + 1e-15).all() and (q >= low - 1e-15).all()
    assert q.max(axis=0) == pytest.approx(high, rel=1e-5)
    assert cycle.motion.rms() == pytest.approx(np.sqrt((q**2).mean(axis=0)), rel=1e-9)
    assert np.abs(cycle.motion.mean()).max() == 0.0
    assert cycle.q(t + cycle.period / 2) == pytest.approx(-q, abs=1e-14)
    c = cycle.harmonics(101)
    assert fourier.synthesis(101, cycle.omega * t) @ c == pytest.approx(q, abs=1e-4 * np.abs(q).max())
    # the equations of motion hold at all times, and the velocity is the rate of the position
    p = bogie.vector(**cycle.parameters)
    r = bogie.residual(q.T, cycle.v(t).T, cycle.a(t).T, p).full()
    assert np.abs(r).max() < 1e-9 * np.abs(bogie.mass(**cycle.parameters) @ cycle.a(t).T).max()
    v = fourier.synthesis(101, cycle.omega * t, 1) @ c * cycle.omega
    assert v == pytest.approx(cycle.v(t), abs=1e-2 * np.abs(v).max())


def test_an_asymmetric_cycle_answers_with_its_mean():
    system = SELF_EXCITED["table"][0]()
    cycle = cycle_of(exact_cycle(system, guess(system, 1.4, H=15), "c"))
    t = np.linspace(0, cycle.period, 8193)[:-1]
    assert cycle.motion.sigma == 1
    assert cycle.motion.mean() == pytest.approx(cycle.q(t).mean(axis=0), abs=1e-7)
    assert cycle.motion.rms() == pytest.approx(np.sqrt((cycle.q(t) ** 2).mean(axis=0)), rel=1e-7)


@pytest.mark.parametrize("wrong", [0, 1])
def test_one_pass_finds_the_sequence(bogie, cycles_at_90, wrong):
    # the sequence given is that of the other cycle, or one that never meets the flange of the rear wheelset
    point = exact_cycle(bogie, cycles_at_90[-1], "V")
    closing, n, S = point.closing, point.closing.n, point.closing.sequence.S
    other = exact_cycle(bogie, cycles_at_90[0], "V").closing.sequence
    poor = (
        other
        if wrong
        else replace(closing.sequence, sides=closing.sequence.sides[:1], events=closing.sequence.events[:1])
    )
    y = np.concatenate([point.y[:n], np.full(poor.S, point.y[n : n + S].sum() / poor.S), point.y[-1:]])
    sequence, start = sequence_passed(replace(closing, sequence=poor), y)
    found = settled(replace(closing, sequence=sequence), start)
    assert sequence.S == S and found.omega == pytest.approx(point.omega, rel=1e-11)
    assert start[n:-1].sum() == pytest.approx(point.y[n:-1].sum(), rel=1e-9)


# --- the model --------------------------------------------------------------------------------


def test_matrices_are_those_of_the_equations(bogie):
    model, p = switched_linear(bogie), bogie.vector()
    assert [s.name for s in model.surfaces] == ["front flange"] * 2 + ["rear flange"] * 2
    x = np.zeros(15)
    x[[0, 2, -1]] = 0.02, -0.03, 1.0
    sides = (model.matrices(np.zeros((1, 4)), p[None])[1][0] @ x > 0).astype(float)
    assert sides.tolist() == [1, 0, 0, 1]
    A, _ = model.matrices(sides[None], p[None])
    assert A[0] @ x == pytest.approx(np.append(bogie.ode(x[:-1], p).full().ravel(), 0.0), rel=1e-13)
    assert A[0][:-1, :-1] == pytest.approx(bogie.ode_jacobian(x[:-1], p).full(), rel=1e-13)
    assert model.mirrored((True, False, False, True)) == (False, True, True, False)


def test_mass_that_couples_and_depends_on_a_parameter():
    m, k = hb.Parameter("m", 2.0), hb.Parameter("k", 3.0)
    import casadi as ca

    M = ca.vertcat(ca.horzcat(m, 0.5 * m), ca.horzcat(0.5 * m, 1.0 + k))
    system = hb.System.from_matrices(
        "coupled", M, 0.1 * np.eye(2), np.eye(2), {"stop": (DeadBand(k, 1.0), [1.0, -1.0])}, [m, k]
    )
    model, p = switched_linear(system), system.vector()
    x = np.array([2.0, 0.5, 0.3, -0.2, 1.0])
    A, _, dA, drows = model.with_slopes(np.array([[1.0, 0.0]]), p[None], 0)
    assert A[0] @ x == pytest.approx(np.append(system.ode(x[:-1], p).full().ravel(), 0.0), rel=1e-13)
    weights, row_weights = np.random.default_rng(0).standard_normal((2, 1, 5, 5))[:, :, :, :]
    row_weights = row_weights[:, :2]
    pulled = model.pulled_back(np.array([[1.0, 0.0]]), p[None], weights, row_weights)
    assert pulled[0, 0] == pytest.approx((weights * dA).sum() + (row_weights * drows).sum(), rel=1e-12)


def test_what_is_not_piecewise_linear_is_refused():
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    cubic = hb.Element("spring", hb.model.Cubic(1.0), x)
    gap = hb.Element("gap", DeadBand(1.0, 1.0), x)
    with pytest.raises(ModelError, match="law of spring is not piecewise linear"):
        switched_linear(hb.System("a", [x], [], [x.ddot + cubic + gap], [cubic, gap]))
    with pytest.raises(ModelError, match="nothing that switches"):
        switched_linear(hb.System("b", [x], [], [x.ddot + x]))
    with pytest.raises(ModelError, match="not linear in the coordinates"):
        switched_linear(hb.System("c", [x, y], [], [x.ddot + gap, y.dot + x * y], [gap]))
