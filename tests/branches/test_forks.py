"""Cycles on branches that begin at pitchforks and period doublings of other cycles, and attract no motion."""

from __future__ import annotations

import numpy as np

from hbbogie import Coordinate, Parameter, System, find_cycles

MU = -0.1
SIZES = np.sqrt(0.5 * (1 + np.array([-1, 1]) * np.sqrt(1 + 4 * MU)))  # roots of mu + w^2 - w^4
RATES = 2 * SIZES**2 - 4 * SIZES**4  # d/dw of w (mu + w^2 - w^4) there, 1/s


def forked(doubled: bool) -> System:
    """Return the circle of radius 1, beside it w' = w (mu + w^2 - w^4): z = w, or w in a frame of half the speed."""
    x, y, mu = Coordinate("x"), Coordinate("y"), Parameter("mu", MU, "1", "", (-2.0, 2.0))
    r2 = x**2 + y**2
    circle = [x.dot - (x * (1 - r2) - y), y.dot - (y * (1 - r2) + x)]
    if not doubled:
        z = Coordinate("z")
        return System(
            "pitchfork", [x, y, z], [mu], [*circle, z.dot - z * (r2 * (mu + z**2 - z**4) - 0.5 * (1 - r2) ** 2)]
        )
    u, v = Coordinate("u"), Coordinate("v")
    w2 = 0.5 * (u**2 + v**2) + 0.5 * (u**2 - v**2) * x + u * v * y
    a, b = mu + w2 - w2**2, -1.0  # rates along the axes of the frame
    half, difference = 0.5 * (a + b), 0.5 * (a - b)
    turning = [
        u.dot - (-0.5 * v + half * u + difference * (x * u + y * v)),
        v.dot - (0.5 * u + half * v + difference * (y * u - x * v)),
    ]
    return System("doubling", [x, y, u, v], [mu], [*circle, *turning])


def has(cycle, multiplier: float) -> bool:
    """Tell whether a cycle has a multiplier, to 1e-6 of it or of 1."""
    return bool(np.abs(cycle.stability.multipliers - multiplier).min() <= 1e-6 * max(1.0, abs(multiplier)))


def test_a_subcritical_pitchfork_leads_to_the_cycles_between():
    found = find_cycles(forked(doubled=False), mu=MU)
    assert len(found) == 5 and found.complete
    heights = sorted(float(o.mean("z")) for o in found)
    np.testing.assert_allclose(heights, [-SIZES[1], -SIZES[0], 0, SIZES[0], SIZES[1]], atol=1e-7)
    for o in found:
        rate = MU if abs(o.mean("z")) < 1e-6 else RATES[int(np.argmin(np.abs(SIZES - abs(o.mean("z")))))]
        assert o.stability.verdict == ("stable" if rate < 0 else "unstable")
        assert has(o, np.exp(2 * np.pi * rate))
    assert any("the branch from the pitchfork at mu = " in said for said in found.evidence)


def test_a_subcritical_period_doubling_leads_to_the_cycles_of_twice_the_period():
    found = find_cycles(forked(doubled=True), mu=MU)
    assert sorted(round(o.period / np.pi, 6) for o in found) == [2, 4, 4] and found.complete
    for o in found:
        assert o.period > 7 or has(o, -np.exp(2 * np.pi * MU))
    doubled = sorted((o for o in found if o.period > 7), key=lambda o: o.amplitude("u"))
    for o, rate in zip(doubled, RATES, strict=True):
        assert o.stability.verdict == ("stable" if rate < 0 else "unstable")
        assert has(o, np.exp(4 * np.pi * rate))
    assert any("the branch from the period doubling at mu = " in said for said in found.evidence)


def test_coupled_oscillators_move_unequally_beyond_their_pitchfork():
    """Two of van der Pol's oscillators: from mu = 0.322 on there are two unequal cycles, images of one another."""
    x, mu = [Coordinate(f"x{i}") for i in range(2)], Parameter("mu", 0.4, "1", "", (-10, 10))
    spring = [0.1 * (x[1 - i] - x[i]) + 0.05 * (x[1 - i].dot - x[i].dot) for i in range(2)]
    equations = [x[i].ddot - mu * (1 - x[i] ** 2) * x[i].dot + x[i] - spring[i] for i in range(2)]
    found = find_cycles(System("pair", x, [mu], equations), mu=0.4)
    peaks = [(o.amplitude("x0"), o.amplitude("x1")) for o in found]
    unequal = [p for p in peaks if abs(p[0] / p[1] - 1) > 1e-6]
    assert len(found) == 4 and len(unequal) == 2
    np.testing.assert_allclose(unequal[0], unequal[1][::-1], rtol=1e-8)
