"""Multipliers followed one by one along a branch: which of them cross the unit circle, and between which points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.bifurcation_tests import MARGIN, Probe
from hbbogie.stability import crossing
from hbbogie.stability.crossing import matched

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
NEUTRAL = 1e-8  # distance from the unit circle, as a logarithm, that is none


@dataclass(frozen=True, eq=False)
class Crossing:
    """A multiplier that is on one side of the unit circle at one point and on the other at a later one.

    Attributes
    ----------
    places : tuple of int
        Those of the points along which it was followed, from the last on one side to the first on the other.
    logs : tuple of complex
        Its logarithm at each of them.
    """

    places: tuple[int, ...]
    logs: tuple[complex, ...]

    @property
    def outward(self) -> bool:
        """Whether it leaves the unit circle."""
        return self.logs[-1].real > 0

    @property
    def positive(self) -> bool:
        """Whether it is real and positive at both ends."""
        return self.logs[0].imag == 0 and self.logs[-1].imag == 0

    def step(self) -> tuple[int, int, complex, complex] | None:
        """Return the neighbours between which it crosses, and its logarithm at both; None where there are none."""
        for k, (a, b) in enumerate(pairwise(self.places)):
            if self.logs[k].real * self.logs[k + 1].real <= 0 and b == a + 1:
                return a, b, self.logs[k], self.logs[k + 1]
        return None


def logarithms(probe: Probe, *, full: bool = False) -> Complex | None:
    """Return the logarithms of the multipliers but the trivial one; None where they are not trusted.

    Parameters
    ----------
    probe : Probe
    full : bool
        Whether those of the full period, also where half a period was integrated.
    """
    known = probe.multipliers
    if known is None:
        return None
    return crossing.logarithms(known[1] ** 2 if full and known[0] else known[1])


def neutral_within(probe: Probe) -> float:
    """Return how far from the unit circle, as a logarithm, a multiplier may be for its error."""
    s = probe.orbit.stability
    return max(MARGIN * s.trivial_error, NEUTRAL) if s is not None else np.inf


def crossings_of(probes: Sequence[Probe]) -> list[Crossing]:
    """Return the crossings of the unit circle, multiplier by multiplier; within its error one is on neither side."""
    found: list[Crossing] = []
    trusted = [i for i, probe in enumerate(probes) if probe.multipliers is not None]
    count = len(_known(probes[trusted[0]])) if trusted else 0
    order, sides = np.arange(count), np.zeros(count)
    paths: list[list[tuple[int, complex]]] = [[] for _ in range(count)]  # since each was last clear of the circle
    for before, i in zip([None, *trusted], trusted, strict=False):
        if before is not None:
            full = probes[before].half != probes[i].half
            order = matched(_known(probes[before], full=full)[order], _known(probes[i], full=full))
        margin = neutral_within(probes[i])
        for k, log in enumerate(_known(probes[i])[order]):
            side = float(np.sign(log.real)) if abs(log.real) > margin else 0.0
            paths[k].append((i, complex(log)))
            if side * sides[k] < 0:
                places, logs = zip(*paths[k], strict=True)
                found.append(Crossing(places, logs))
            if side:
                sides[k], paths[k] = side, [(i, complex(log))]
    return found


def _known(probe: Probe, *, full: bool = False) -> Complex:
    logs = logarithms(probe, full=full)
    assert logs is not None  # asked for where they are trusted
    return logs


def followed(a: Probe, log: complex, there: Probe) -> complex:
    """Return the logarithm at another point of a multiplier of the point a; NaN where it is not known."""
    full = a.half != there.half
    logs = logarithms(there, full=full)
    if logs is None:
        return complex("nan")
    place = int(np.argmin(np.abs(_known(a) - log)))
    found = logs[matched(_known(a, full=full), logs)[place]]
    return complex(found / 2 if full and a.half else found)
