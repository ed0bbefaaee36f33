"""Multipliers followed one by one: how many cross together, and which are within their error."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import hbbogie as hb
from hbbogie import Coordinate, HarmonicBalance, Parameter, System

SHEAR, TURN = 2.0, 0.7  # of the frequency with the amplitude, and of the coupling


def exponents(m: float, N: int) -> np.ndarray:
    """Of a disturbance that leaves the mean of N oscillators z' = z (1 + i 2 - (1 + i 2) s) + m (1 - i 0.7) L z."""
    coupling = -N * m * (1 - 1j * TURN)
    return np.linalg.eigvals(
        np.array([[-2 + coupling.real, -coupling.imag], [-2 * SHEAR + coupling.imag, coupling.real]])
    )


def coupled(N: int) -> tuple[System, hb.Orbit]:
    """N oscillators, each coupled to all: z' = z (1 + 1 i - (1 + 2 i) s) + m (1 - 0.7 i) L z; s = 1 in phase."""
    m, q = Parameter("m", 0.5), [Coordinate(f"{a}{i}") for i in range(N) for a in "xy"]
    equations = []
    for i in range(N):
        x, y = q[2 * i], q[2 * i + 1]
        s, lx, ly = x * x + y * y, sum(q[::2]) - N * x, sum(q[1::2]) - N * y
        equations += [
            x.dot - (x - y - s * (x - SHEAR * y) + m * (lx + TURN * ly)),
            y.dot - (y + x - s * (y + SHEAR * x) + m * (ly - TURN * lx)),
        ]
    c = np.zeros((3, 2 * N))
    c[1, ::2], c[2, 1::2] = 1.0, -1.0
    return System("coupled", q, [m], equations), hb.Orbit(
        "coupled", tuple(a.name for a in q), ("",) * (2 * N), c, 1.0, {"m": 0.5}
    )


@pytest.mark.parametrize("N", [3, 4])
def test_how_many_cross_together(N):
    """N - 1 equal pairs of exponents: they cross the axis where their sum is 0, one of each where the product is."""
    system, start = coupled(N)
    branch = hb.trace(HarmonicBalance(3).equations(system), start, "m", (-0.75, 1.0), longest=0.1)
    torus = -1.0 / N  # -2 - 2 N m = 0
    zero = brentq(lambda m: float(np.prod(exponents(m, N)).real), -0.1 / N, 0.1 / N)
    other = brentq(lambda m: float(np.prod(exponents(m, N)).real), 0.05 / N, 2.0 / N)
    assert {s.kind for s in branch.special} <= {"Neimark-Sacker", "branch point"}
    tori = [s for s in branch.special if s.kind == "Neimark-Sacker"]
    crossing = [s for s in branch.special if s.kind == "branch point"]
    assert [s.value for s in tori] == pytest.approx([torus], abs=1e-6)
    assert f"{N - 1} pairs cross together" in tori[0].status
    assert sorted(s.value for s in crossing) == pytest.approx(sorted([zero, other]), abs=1e-6)
    assert all(f"{N - 1} multipliers cross together" in s.status for s in crossing)


def test_a_flip_and_a_change_of_order():
    """A Moebius strip: a disturbance (a, b) of the circle s = 1 makes half a turn a period, and a grows like m."""
    x, y, a, b, m = (*(Coordinate(name) for name in "xyab"), Parameter("m", -0.3))
    s = x * x + y * y
    # in the frame that turns by t / 2 the rates are m along the first axis and -0.2 along the second
    mean, half = (m - 0.2) / 2, (m + 0.2) / 2
    along = mean * a + half * (x * a + y * b) - b / 2, mean * b + half * (y * a - x * b) + a / 2
    equations = [x.dot - (x - y - s * x), y.dot - (y + x - s * y), a.dot - along[0], b.dot - along[1]]
    system = System("strip", [x, y, a, b], [m], equations)
    c = np.zeros((3, 4))
    c[1, 0] = c[2, 1] = 1.0
    start = hb.Orbit("strip", ("x", "y", "a", "b"), ("",) * 4, c, 1.0, {"m": -0.3})
    branch = hb.trace(HarmonicBalance(3).equations(system), start, "m", (-0.4, 0.4), longest=0.1)
    (flip,) = branch.special  # exp(2 pi m) and exp(-0.4 pi), both with the sign of a half turn; equal at m = -0.2
    assert flip.kind == "period doubling" and "together" not in flip.status
    assert flip.value == pytest.approx(0.0, abs=1e-7)


def test_a_cycle_that_the_harmonics_do_not_resolve_is_judged_polished():
    """Van der Pol's cycle is stable for every mu > 0; 15 harmonics leave an error of the trivial multiplier of 1."""
    system = hb.load_problem("van_der_pol").van_der_pol()
    equations = HarmonicBalance(15).equations(system)
    start = hb.solve(equations, hb.find_cycles(system, mu=4.0, stability=False, harmonics=31)[0], mu=4.0)
    assert hb.floquet(system, start).verdict == "unknown"
    branch = hb.trace(equations, start, "mu", (3.9, 4.1))
    assert set(branch.verdicts) == {"stable"} and branch.special == ()
    assert "Judged on the cycle with harmonics up to" in branch.orbits[-1].stability.reason
