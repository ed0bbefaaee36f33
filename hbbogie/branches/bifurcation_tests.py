"""Test functions at the points of a curve of cycles, whose changes of sign mark special points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.branches.judging import stabilities_of
from hbbogie.deadline import time_is_over
from hbbogie.results import Orbit
from hbbogie.solving.curve import Point
from hbbogie.stability.variation import Waveforms

Complex = NDArray[np.complex128]

MARGIN = 5.0  # a multiplier may be off by so many errors of the trivial one
TRUSTED = 1e-2  # largest error of the trivial multiplier with which multipliers are looked at

Contacts = dict[tuple[str, int], tuple[float, float]]
Kind = str | tuple[str, int]  # "fold", "branching"; or a contact, by its name and number


@dataclass(frozen=True, eq=False)
class _Judged:
    """Points of a curve, as a branch has them; what is asked of one is computed for all of them together.

    Attributes
    ----------
    curve : CycleCurve
    points : sequence of Point
    judge : bool
        Whether multipliers are computed.
    polish : bool
        Whether those of the cycle polished by shooting are taken where its own are not trusted.
    """

    curve: CycleCurve
    points: Sequence[Point]
    judge: bool
    polish: bool = True

    @cached_property
    def cycles(self) -> list[Orbit]:
        """The cycles, not judged."""
        return self.curve.orbits(self.points)

    @cached_property
    def orbits(self) -> list[Orbit]:
        """The cycles, with their stability where they are to be judged and can be, as long as there is time."""
        if not self.judge or time_is_over():
            return self.cycles
        # one alone is where a special point is located: there multipliers meet
        found = stabilities_of(self.curve.equations.system, self.cycles, self.polish, level=len(self.points) > 1)
        return [cycle.replace(stability=stability) for cycle, stability in zip(self.cycles, found, strict=True)]

    @cached_property
    def contacts(self) -> list[Contacts]:
        """Each gap of each contact along each cycle, and how far that reaches beyond, relative to its motion."""
        system = self.curve.equations.system
        names = [e.name for e in system.elements if e.ramps is not None]
        if not names:
            return [{} for _ in self.points]
        p = np.array([self.curve.problem.parameters(point.u) for point in self.points])
        waves = Waveforms(system, self.cycles, p)
        low, high = waves.u.extremes
        owner, d, g = waves.model.owner, waves.model.direction, waves.threshold
        size = np.maximum(high - low, np.finfo(float).tiny)[:, owner]
        reach = (np.where(d > 0, high[:, owner], -low[:, owner]) - g) / size
        number = np.arange(len(owner)) - np.searchsorted(owner, owner)
        keys = [(names[i], int(k)) for i, k in zip(owner, number, strict=True)]
        gaps = np.stack([d * g, reach], axis=2)
        return [
            {key: (float(gap), float(beyond)) for key, (gap, beyond) in zip(keys, own, strict=True)} for own in gaps
        ]


@dataclass(frozen=True, eq=False)
class Probe:
    """A point of a curve with its cycle, its stability and its test functions, computed when asked for.

    Attributes
    ----------
    among : _Judged
        The points of which it is one.
    place : int
    """

    among: _Judged
    place: int

    @property
    def curve(self) -> CycleCurve:
        """The curve."""
        return self.among.curve

    @property
    def judge(self) -> bool:
        """Whether multipliers are computed."""
        return self.among.judge

    @property
    def polish(self) -> bool:
        """Whether the multipliers of the polished cycle are taken where its own are not trusted."""
        return self.among.polish

    @property
    def point(self) -> Point:
        """The point."""
        return self.among.points[self.place]

    @property
    def cycle(self) -> Orbit:
        """The cycle, not judged."""
        return self.among.cycles[self.place]

    @property
    def orbit(self) -> Orbit:
        """The cycle, with its stability where it is to be judged and can be."""
        return self.among.orbits[self.place]

    @property
    def contacts(self) -> Contacts:
        """Each gap of each contact, and how far it reaches beyond, relative to its motion, by name and number."""
        return self.among.contacts[self.place]

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

    def side(self, kind: Kind) -> float:
        """Return a number of the sign of a test function, and 0 where that is; of "branching" the sign alone."""
        return (kind == "branching" and self.point.orientation) or self.value(kind)


def probes_of(curve: CycleCurve, points: Sequence[Point], judge: bool, polish: bool = True) -> list[Probe]:
    """Return the probes of points; what is asked of one is computed for all of them together."""
    among = _Judged(curve, points, judge, polish)
    return [Probe(among, k) for k in range(len(points))]
