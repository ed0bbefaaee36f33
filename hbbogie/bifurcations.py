"""Special points along a branch of cycles: test functions, location, and what begins at each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import ModelError
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.solution_curve import Curve, Point
from hbbogie.stability import floquet
from hbbogie.switching import asymmetric, crossing, doubled
from hbbogie.variation import Waveform

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

VERTICAL = 1e-9  # share of the parameter in the tangent below which it counts as constant
TRUSTED = 1e-2  # largest error of the trivial multiplier with which multipliers are looked at
MARGIN = 5.0  # a multiplier may be off by so many errors of the trivial one
NEARLY_ODD = 1e-5  # even harmonics, relative to the largest, of a symmetric cycle that is not solved to the last digit
REAL = 1e-6  # imaginary part below which a pair of multipliers counts as real
SAME = 1e-6  # length of arc within which contacts happen together
FORK = 1e-3  # length of arc within which two pitchforks are one
TOUCHING = 1e-6  # distance of a contact from its gap, relative to its motion, that counts as none
ZERO = 1e-2  # where a test function is located it has fallen by this much, else it jumps

Kind = str | tuple[str, float]  # "fold", "branching", "flip", "torus"; or a contact, by its name and gap


@dataclass(frozen=True, eq=False)
class Probe:
    """A point of the curve with its cycle, its stability and its test functions, computed when asked for.

    Attributes
    ----------
    curve : Curve
    point : Point
    judge : bool
        Whether multipliers are computed.
    """

    curve: Curve
    point: Point
    judge: bool

    @cached_property
    def cycle(self) -> Orbit:
        """The cycle, not judged."""
        return self.curve.orbit(self.point)

    @cached_property
    def orbit(self) -> Orbit:
        """The cycle, with its stability where it is to be judged and can be."""
        if not self.judge:
            return self.cycle
        try:
            return self.cycle.replace(stability=floquet(self.curve.equations.system, self.cycle))
        except (ModelError, RuntimeError, np.linalg.LinAlgError):
            return self.cycle

    @cached_property
    def multipliers(self) -> tuple[bool, Complex] | None:
        """Whether those of half a period, and the multipliers, the trivial one last; None where not trusted."""
        s = self.orbit.stability
        if s is None or not s.trivial_error <= TRUSTED:
            return None
        half = s.half_multipliers is not None
        m = s.half_multipliers if s.half_multipliers is not None else s.multipliers
        trivial = int(np.argmin(np.abs(m - 1)))
        return half, np.append(np.delete(m, trivial), m[trivial])

    def factors(self, kind: str) -> Complex:
        """Return the factors whose product changes its sign at -1, "flip", or on the circle, "torus"; else none."""
        known = self.multipliers
        if known is None:
            return np.empty(0, dtype=complex)
        if kind == "flip":
            return np.asarray(known[1] + 1)
        return np.array([a * b - 1 for a, b in combinations(known[1][:-1], 2)], dtype=complex)

    def value(self, kind: Kind) -> float:
        """Return a test function; NaN where it is not known."""
        if isinstance(kind, tuple):
            return self.reaches[kind]
        if kind == "fold":
            return float(self.point.tangent[-1])
        if kind == "branching":
            return self.curve.branching(self.point)
        factors = self.factors(kind)
        return float(np.prod(factors).real) if len(factors) else float("nan")

    @cached_property
    def reaches(self) -> dict[tuple[str, float], float]:
        """How far each contact reaches beyond each of its gaps, relative to its motion, by name and gap."""
        orbit, system = self.cycle, self.curve.equations.system
        names = [e.name for e in system.elements if e.ramps is not None]
        if not names:
            return {}
        wave = Waveform(system, orbit, system.vector(**orbit.parameters))
        low, high = fourier.extremes(wave.u)
        span = np.maximum(high - low, np.finfo(float).tiny)
        return {
            (name, float(d * g)): float(((high[i] if d > 0 else -low[i]) - g) / span[i])
            for i, name in enumerate(names)
            for d, g in zip(wave.directions[i], wave.ramps[i][3], strict=True)
        }


def special_points(
    curve: Curve, points: list[Point], *, judge: bool, known: Mapping[int, SpecialPoint]
) -> tuple[list[Orbit], tuple[SpecialPoint, ...]]:
    """Locate what happens between the points of a curve.

    Parameters
    ----------
    curve : Curve
    points : list of Point
    judge : bool
        Whether to compute the stability of every cycle and look at the multipliers; folds only without.
    known : mapping from int to SpecialPoint
        Special points at which the curve begins, by the place of the point.

    Returns
    -------
    orbits : list of Orbit
        The cycles of the points, with those of the special points put in between.
    special : tuple of SpecialPoint
        In the order of the curve.
    """
    probes = [Probe(curve, point, judge) for point in points]
    orbits, special = [probes[0].orbit], [*_at(known, 0, probes[0]), *_touching(curve, probes)]
    for i, (a, b) in enumerate(pairwise(probes)):
        begins = not {i, i + 1}.isdisjoint(known)
        found = _between(curve, a, b, judge, begins)
        orbits += [s.orbit for _, s in found] + [b.orbit]
        special += [*(s for _, s in found), *_at(known, i + 1, b)]
    return orbits, tuple(special)


def _at(known: Mapping[int, SpecialPoint], place: int, probe: Probe) -> list[SpecialPoint]:
    """Return the special point that is known at a place, with the cycle of the curve where it passes through."""
    if place not in known:
        return []
    through = known[place].kind in ("pitchfork", "branch point")
    return [replace(known[place], orbit=probe.orbit) if through else known[place]]


def _touching(curve: Curve, probes: list[Probe]) -> list[SpecialPoint]:
    """Return the grazing with which a curve begins, where linear cycles end and a gap closes."""
    if not probes[0].judge or len(probes) < 2:
        return []
    first, second = probes[0].reaches, probes[1].reaches
    contacts = [
        _Contact(0.0, k, second[k] > 0, probes[0], 0.0) for k in first if abs(first[k]) <= TOUCHING < abs(second[k])
    ]
    return [_grazing(curve, contacts)] if contacts else []


def _between(curve: Curve, a: Probe, b: Probe, judge: bool, begins: bool) -> list[tuple[float, SpecialPoint]]:
    """Return what happens between two neighbours, with the length of arc from the first, in order.

    Where one of them is the special point at which the curve begins, no further branch is looked for.
    """
    kinds: list[Kind] = ["fold"]
    if judge:
        known = a.multipliers, b.multipliers
        comparable = known[0] is not None and known[1] is not None and known[0][0] == known[1][0]
        kinds += [*(["branching"] if not begins else []), *(["flip", "torus"] if comparable else []), *a.reaches]
    found: list[tuple[float, SpecialPoint]] = []
    contacts: list[_Contact] = []
    for kind in kinds:
        ends = a.value(kind), b.value(kind)
        smallest = TOUCHING if isinstance(kind, tuple) else VERTICAL if kind == "fold" else 0.0
        if not ends[0] * ends[1] < 0 or min(map(abs, ends)) <= smallest:
            continue  # no change, or none to speak of: cycles of a linear or conservative system
        if (located := _located(curve, a, b, kind, ends)) is None:
            continue
        at, length, reach = located
        if not isinstance(kind, str):
            contacts.append(_Contact(length, kind, ends[1] > 0, at, reach))
        elif (point := _special(curve, at, kind, (a.point.tangent, b.point.tangent), reach)) is not None:
            found.append((length, point))
    for group in _groups(contacts):
        found.append((group[0].length, _grazing(curve, group)))
    forks = [f for f in found if f[1].kind == "pitchfork"]
    if len(forks) == 2 and abs(forks[0][0] - forks[1][0]) < FORK:  # seen by the Jacobian and by the multipliers
        found.remove(max(forks, key=lambda f: f[1].interval[1] - f[1].interval[0]))
    if judge and not begins and all(s.kind == "grazing" for _, s in found):
        found += _unexplained(curve, a, b)
    return sorted(found, key=lambda f: f[0])


def _unexplained(curve: Curve, a: Probe, b: Probe) -> list[tuple[float, SpecialPoint]]:
    """Return what says that a change of stability between two neighbours was not located, if there is one."""
    before, after = a.orbit.stability, b.orbit.stability
    if before is None or after is None or "unknown" in (before.verdict, after.verdict):
        return []
    if before.unstable == after.unstable:
        return []
    ends = sorted((float(a.point.y[-1]), float(b.point.y[-1])))
    what = f"unstable directions go from {before.unstable} to {after.unstable} in this interval"
    status = f"{what}; what happens there was not located: take more harmonics or shorter steps"
    point = SpecialPoint("not located", curve.parameter, ends[1], (ends[0], ends[1]), b.cycle, status)
    return [(curve.distance(a.point, b.point), point)]


@dataclass(frozen=True, eq=False)
class _Contact:
    """A contact (element, gap) that begins to close, or ceases to, at a length of arc."""

    length: float
    kind: tuple[str, float]
    closes: bool
    probe: Probe
    reach: float


def _groups(contacts: list[_Contact]) -> list[list[_Contact]]:
    """Return the contacts that happen together: both sides of a symmetric motion, or two elements at once."""
    groups: list[list[_Contact]] = []
    for c in sorted(contacts, key=lambda c: c.length):
        if groups and abs(groups[-1][0].length - c.length) < SAME:
            groups[-1].append(c)
        else:
            groups.append([c])
    return groups


def _located(
    curve: Curve, a: Probe, b: Probe, kind: Kind, ends: tuple[float, float]
) -> tuple[Probe, float, float] | None:
    """Locate a change of sign of a test function.

    Returns
    -------
    probe, length, reach : Probe, float, float
        The point, its length of arc from a, and by how much the parameter may be off. None where it is a jump, or
        cannot be followed.
    """
    probes = {id(a.point): a, id(b.point): b}

    def test(point: Point) -> float:
        if id(point) not in probes:
            probes[id(point)] = Probe(curve, point, a.judge)
        return probes[id(point)].value(kind)

    found = curve.locate(a.point, b.point, test)
    if found is None:
        return None
    at, error = probes[id(found[0])], found[1]
    if not abs(at.value(kind)) <= max(ZERO * min(map(abs, ends)), 1e-9):
        return None
    if kind == "branching":  # next to a crossing branch a point may be off its own by the root of what is tolerated
        error += float(np.sqrt(curve.tolerance))
    else:
        error += float(np.abs(at.point.residual / curve.rows).max()) / abs(curve.branching(at.point))
    if kind in ("flip", "torus") and (stability := at.orbit.stability) is not None:
        others = float(np.prod(np.sort(np.abs(at.factors(str(kind))))[1:]))
        slope = abs(ends[1] - ends[0]) / curve.distance(a.point, b.point)
        error += others * MARGIN * stability.trivial_error / slope
    # where branches cross the tangent is any in their plane: those of the neighbours tell how the parameter goes
    points = (a.point, b.point) if kind == "branching" else (at.point,)
    along = max(abs(float(point.tangent[-1])) for point in points) * float(curve.scale[-1])
    return at, curve.distance(a.point, at.point), max(error * along, 1e-12 * abs(float(at.point.y[-1])))


def _special(curve: Curve, at: Probe, kind: str, tangents: tuple[Array, Array], reach: float) -> SpecialPoint | None:
    """Return the special point of a located change of sign; None where it is nothing."""
    system, orbit, value = curve.equations.system, at.orbit, float(at.point.y[-1])
    onward = None
    if kind == "fold":
        name, extreme = kind, "smallest" if tangents[1][-1] > 0 else "largest"
        status = (
            f"{extreme} value of {curve.parameter} along the branch; slope {at.point.tangent[-1]:.1e} where located"
        )
    elif kind == "branching":
        onward = crossing(curve, at.point, tangents[0] + tangents[1])
        breaks = fourier.is_odd(orbit.coefficients, NEARLY_ODD) and not fourier.is_odd(onward.coefficients, NEARLY_ODD)
        name, what = ("pitchfork", "the symmetry breaks") if breaks else ("branch point", "another branch crosses")
        status = f"{what}; smallest singular value {abs(at.value(kind)):.1e} where located"
    else:
        known = at.multipliers
        if known is None:
            return None
        half, m = known
        if kind == "flip":
            name, begin = ("pitchfork", asymmetric) if half else ("period doubling", doubled)
            onward, nearest = begin(system, orbit), m[np.argmin(np.abs(m + 1))].real
            what = "the symmetry breaks" if half else "a cycle of twice the period begins"
            status = f"{what}; multiplier {nearest:.8f}{' of half a period' * half} where located"
        else:
            pair = m[:-1][np.argsort(np.abs(np.abs(m[:-1]) - 1))[:2]] ** (2 if half else 1)
            if len(pair) < 2 or np.abs(pair.imag).min() < REAL:
                return None  # two real multipliers with product 1: nothing changes
            name, angle = "Neimark-Sacker", abs(np.angle(pair[0]))
            status = f"a torus begins; multipliers {abs(pair[0]):.8f} exp(+-{angle:.6f} i) where located"
    s = orbit.stability
    # at a fold the trivial multiplier meets another, and carries the root of the error
    if s is not None and s.trivial_error > (TRUSTED**0.5 if kind == "fold" else TRUSTED):
        status += f"; the cycle is not resolved, its trivial multiplier is off by {s.trivial_error:.1g}"
    return SpecialPoint(name, curve.parameter, value, (value - reach, value + reach), orbit, status, onward)


def _grazing(curve: Curve, contacts: list[_Contact]) -> SpecialPoint:
    """Return the point where contacts begin or cease to close."""
    at, reach = contacts[0].probe, contacts[0].reach
    gaps: dict[str, list[str]] = {}
    for c in contacts:
        what = "begins to touch" if c.closes else "touches for the last time"
        gaps.setdefault(f"{c.kind[0]} {what}", []).append(f"{c.kind[1]:g}")
    status = "; ".join(f"{what} at {' and '.join(levels)}" for what, levels in gaps.items())
    value = float(at.point.y[-1])
    return SpecialPoint("grazing", curve.parameter, value, (value - reach, value + reach), at.orbit, status)
