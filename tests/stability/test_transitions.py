"""Transition matrices: exponentials against SciPy's, and against those of Gauss collocation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet

import hbbogie as hb
from hbbogie.branches import stabilities_of
from hbbogie.exponential import exponentials, exponentials_with_derivative
from hbbogie.model import DeadBand
from hbbogie.stability import Waveforms, floquet


def test_exponentials():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((2, 3, 6, 6))
    A[0, 1] = 5 * np.diag(np.ones(5), 1)  # one Jordan block
    D, of, h = (
        rng.standard_normal(A.shape),
        np.array([2, 0, 1, 0]),
        np.array([[0.1, 3.0, 1.0, -0.5], [8.0, 1e-9, 0, 1]]),
    )
    levels, L = exponentials_with_derivative(A, D, of, h)
    for b in range(2):
        for i, u in enumerate(of):
            E, dE = expm_frechet(A[b, u] * h[b, i], D[b, u] * h[b, i])
            assert levels[3][b, i] == pytest.approx(E, abs=1e-13 * np.abs(E).max() * max(1, abs(h[b, i])))
            assert L[b, i] == pytest.approx(dE, abs=1e-12 * max(np.abs(dE).max(), 1e-300))
            for part, level in zip((8, 4, 2), levels, strict=False):
                E = expm(A[b, u] * h[b, i] / part)
                assert level[b, i] == pytest.approx(E, abs=1e-13 * np.abs(E).max())
    assert all((a == b).all() for a, b in zip(levels, exponentials(A, of, h), strict=True))


def test_collocation_and_exponentials_agree(bogie, cycles_at_90):
    """Two independent ways, to round-off where a multiplier has not decayed below it."""
    for orbit in cycles_at_90:
        exact, found = floquet(bogie, orbit).multipliers, floquet(bogie, orbit, steps=200).multipliers
        large = np.abs(exact) > 1e-3
        assert found[large] == pytest.approx(exact[large], rel=1e-9)


def test_the_determinant_of_a_stiff_system_is_not_lost():
    """A fast mode decays by exp(-6000) over the period: only its smallness is known, and the gate is met.

    The slow pair is a mass with a stop: two rotations in closed form.
    """
    x, y, k, r = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("k", 3.0), hb.Parameter("r", 1000.0)
    stop = hb.Element("stop", DeadBand(k, 0.5), x)
    system = hb.System("stop and filter", [x, y], [k, r], [x.ddot + x + stop, y.dot + r * (y - x)], [stop])
    orbit = hb.Orbit(system.name, ("x", "y"), ("", ""), np.array([[0.0, 0], [1, 1], [0, 0]]), 1.0, dict(system.values))
    result = floquet(system, orbit, tolerance=1e6)  # the orbit is none of the system's, its map is known all the same
    a = np.arccos(0.5)

    def turn(w: float, t: float) -> np.ndarray:
        return np.array([[np.cos(w * t), np.sin(w * t) / w], [-w * np.sin(w * t), np.cos(w * t)]])

    half = turn(2.0, 2 * a) @ turn(1.0, np.pi - 2 * a)
    exact = np.linalg.eigvals(half @ half)
    assert np.sort_complex(result.multipliers[:2]) == pytest.approx(np.sort_complex(exact), rel=1e-12)
    assert abs(result.multipliers[2]) < 1e-15
    assert float(result.reason.rsplit(" ", 1)[1][:-1]) < 1e-12  # of the logarithm of the determinant


@pytest.mark.parametrize("beyond", [1e-3, 1e-7, 1e-9, 1e-12, -1e-12, -1e-3])
def test_contacts_that_last_for_less_than_the_phase_grid_resolves(beyond):
    """CLOSED FORM: cos(tau - 0.3) passes 1 - beyond arccos(1 - beyond) before and after 0.3, and half a period on."""
    x, k, gap = hb.Coordinate("x"), hb.Parameter("k", 3.0), 1.0 - beyond
    stop = hb.Element("stop", DeadBand(k, gap), x)
    system = hb.System("stop", [x], [k], [x.ddot + x + stop], [stop])
    c = np.array([[0.0], [np.cos(0.3)], [np.sin(0.3)]])
    orbit = hb.Orbit(system.name, ("x",), ("",), c, 1.0, dict(system.values))
    phases, of = Waveforms(system, [orbit], system.vector()[None]).switchings()
    known = np.array([])
    if beyond > 0:
        half = np.arccos(gap)
        known = np.sort(np.mod(np.add.outer([0.3, 0.3 + np.pi], [-half, half]).ravel(), 2 * np.pi))
    assert len(of) == len(known)
    assert phases == pytest.approx(known, abs=1e-15 / abs(beyond) ** 0.5 + 1e-13)


@pytest.mark.parametrize("name", ["bogie", "van der Pol"])
def test_cycles_judged_together_are_judged_as_each_alone(name, bogie, cycles_at_90):
    """IDENTITY: a batch is nothing but its members, by exponentials and by steps."""
    system, orbits = bogie, list(cycles_at_90)
    if name != "bogie":
        system = hb.load_problem("van_der_pol").van_der_pol(mu=0.5)
        equations = hb.HarmonicBalance(9).equations(system)
        first = hb.Orbit(system.name, ("x",), ("",), np.array([[0.0], [2.0], [0.0]]), 1.0, dict(system.values))
        orbits = [hb.solve(equations, first, mu=mu) for mu in (0.2, 0.5, 0.8)]
    orbits = [o.replace(stability=None) for o in orbits]
    for together, orbit in zip(stabilities_of(system, orbits), orbits, strict=True):
        alone = floquet(system, orbit)
        assert together is not None and together.verdict == alone.verdict
        assert together.multipliers == pytest.approx(alone.multipliers, abs=1e-12)
