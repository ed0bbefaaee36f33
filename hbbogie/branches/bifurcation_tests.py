"""Test functions at the points of a curve of cycles, whose changes of sign mark special points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.branches.judging import stability_of
from hbbogie.deadline import time_is_over
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.solving.curve import Point
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.variation import Waveform

Complex = NDArray[np.complex128]

MARGIN = 5.0  # a multiplier may be off by so many errors of the trivial one
TRUSTED = 1e-2  # largest error of the trivial multiplier with which multipliers are looked at

Kind = str | tuple[str, int]  # "fold", "branching"; or a contact, by its name and number


@dataclass(frozen=True, eq=False)
class Probe:
    """A point of the curve with its cycle, its stability and its test functions, computed when asked for.

    Attributes
    ----------
    curve : CycleCurve
    point : Point
    judge : bool
        Whether multipliers are computed.
    polish : bool
        Whether those of the cycle polished by shooting are taken where its own are not trusted.
    """

    curve: CycleCurve
    point: Point
    judge: bool
    polish: bool = True

    @cached_property
    def cycle(self) -> Orbit:
        """The cycle, not judged."""
        return self.curve.orbit(self.point)

    @cached_property
    def orbit(self) -> Orbit:
        """The cycle, with its stability where it is to be judged and can be, as long as there is time."""
        if not self.judge or time_is_over():
            return self.cycle
        system = self.curve.equations.system
        if self.polish:
            return self.cycle.replace(stability=stability_of(system, self.cycle))
        try:
            return self.cycle.replace(stability=floquet(system, self.cycle))
        except FAILURES:
            return self.cycle

    @property
    def value_error(self) -> float:
        """By how much the parameter of the point may be off, by what is left of the equations and round-off."""
        left = float(np.linalg.norm(self.point.residual) + np.finfo(float).eps)
        return self.curve.inaccuracy(self.point, left) * float(self.curve.scale[-1])

    @property
    def half(self) -> bool | None:
        """Whether the multipliers are those of half a period; None where they are not trusted."""
        return None if self.multipliers is None else self.multipliers[0]

    @cached_property
    def multipliers(self) -> tuple[bool, Complex] | None:
        """Whether those of half a period, and the multipliers but the trivial one; None where not trusted."""
        s = self.orbit.stability
        if s is None or not s.trivial_error <= TRUSTED:
            return None
        half = s.half_multipliers
        m = s.multipliers if half is None else half
        off = np.abs(np.abs(s.multipliers - 1) - s.trivial_error)  # none for the one that was taken for trivial
        trivial = int(np.argmin(np.where(m.real > 0, off, np.inf)))
        return half is not None, np.delete(m, trivial)

    def value(self, kind: Kind) -> float:
        """Return a test function; NaN where it is not known."""
        if isinstance(kind, tuple):
            return self.contacts[kind][1]
        if kind == "fold":
            return float(self.point.tangent[-1])
        return self.curve.branching(self.point)

    @cached_property
    def contacts(self) -> dict[tuple[str, int], tuple[float, float]]:
        """Each gap of each contact, and how far it reaches beyond, relative to its motion, by name and number."""
        orbit, system = self.cycle, self.curve.equations.system
        names = [e.name for e in system.elements if e.ramps is not None]
        if not names:
            return {}
        wave = Waveform(system, orbit, system.vector(**orbit.parameters))
        low, high = wave.u.extremes
        owner, d, g = wave.model.owner, wave.model.direction, wave.threshold
        reach = (np.where(d > 0, high[owner], -low[owner]) - g) / np.maximum(high - low, np.finfo(float).tiny)[owner]
        first = np.searchsorted(owner, owner)
        return {
            (names[i], k): (float(gap), float(beyond))
            for i, k, gap, beyond in zip(owner, np.arange(len(owner)) - first, d * g, reach, strict=True)
        }
