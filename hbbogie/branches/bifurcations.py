"""Special points along a branch of cycles: test functions, location, and the branches that begin there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.bifurcation_tests import TRUSTED, Kind, Probe, probes_of
from hbbogie.branches.cycle_curve import VERTICAL, CycleCurve
from hbbogie.branches.fold_error import doubt_on_branch
from hbbogie.branches.multiplier_points import Located, at_minus_one, with_multipliers
from hbbogie.branches.switching import crossing
from hbbogie.methods.equations import Equations
from hbbogie.methods.level import within_level
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.solving.arclength import distance, located, point_at
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]

NEARLY_ODD = 1e-5  # even harmonics, relative to the largest, of a symmetric cycle that is not solved to the last digit
SAME = 1e-6  # length of arc within which contacts happen together, and a point is the special one itself
FORK = 1e-3  # length of arc within which two points at which branches cross are one
TOUCHING = 1e-6  # distance of a contact from its gap, relative to its motion, that counts as none
FLAT = "; the parameter varies too little along the branch for a smaller interval"
BETWEEN = 1e-10  # largest scaled residual of a point between those of a branch
ZERO = 1e-2  # where a test function is located it has fallen by this much, else it jumps


def special_points(
    curve: CycleCurve,
    points: list[Point],
    *,
    judge: bool,
    known: Mapping[int, SpecialPoint],
    doubts: bool = True,
) -> tuple[list[Orbit], tuple[SpecialPoint, ...]]:
    """Locate what happens between the points of a curve.

    Parameters
    ----------
    curve : CycleCurve
    points : list of Point
    judge : bool
        Whether to compute the stability of every cycle and look at the multipliers; folds only without.
    known : mapping from int to SpecialPoint
        Special points at which the curve begins, by the place of the point.
    doubts : bool
        Whether each fold is looked at more closely, and its status says why it may be none.

    Returns
    -------
    orbits : list of Orbit
        The cycles of the points, with those of the special points put in between.
    special : tuple of SpecialPoint
        In the order of the curve.
    """
    probes = probes_of(curve, points, judge)
    arcs = _arcs(curve, points)
    kinds: list[Kind] = ["fold"]
    if curve.vertical(points):
        kinds = ["branching"]
    elif judge:
        kinds += ["branching", *probes[0].contacts]
    found = _changes(curve, probes, arcs, kinds, known)
    if doubts:
        found = [(arc, _doubted(curve, s) if s.kind == "fold" else s) for arc, s in found]
    if judge:
        found = _forks_once(with_multipliers(curve, probes, arcs, found, known)) + _touching(curve, probes)
    own = {id(probe.orbit) for probe in probes}
    between = [(arc, s.orbit) for arc, s in found if id(s.orbit) not in own]
    orbits = sorted([*zip(arcs, (probe.orbit for probe in probes), strict=True), *between], key=lambda o: o[0])
    special = sorted([*((arcs[i], _at(s, probes[i])) for i, s in known.items()), *found], key=lambda f: f[0])
    return [orbit for _, orbit in orbits], tuple(s for _, s in special)


def forks_of(equations: Equations, branch: Branch, interval: tuple[float, float]) -> list[SpecialPoint]:
    """Locate where other branches begin or cross along a branch of harmonic balance.

    The multipliers are those of its cycles as they are. Where these are not resolved nothing is looked for.

    Parameters
    ----------
    equations : Equations
        Of the branch.
    branch : Branch
    interval : (float, float), unit of the parameter
        Over which it was followed.
    """
    first = branch.orbits[0]
    equations = within_level(equations.phased(first), first)
    p = equations.system.vector(**first.parameters)
    curve = CycleCurve(equations, branch.parameter, interval, p, BETWEEN)
    u = np.array([np.append(equations.encode(o), o.parameters[branch.parameter]) for o in branch.orbits])
    if len(u) < 3 or curve.steady(u[:, -1]):
        return []
    points = []
    for here, chord in zip(u, np.gradient(u / curve.scale, axis=0), strict=True):
        with suppress(np.linalg.LinAlgError):  # exactly where another branch crosses
            points.append(point_at(curve, here, chord))
    probes, arcs = probes_of(curve, points, True, polish=False), _arcs(curve, points)
    found = _changes(curve, probes, arcs, ["branching"], {})
    found = [f for f in found if f[1].orbit.stability and f[1].orbit.stability.trivial_error <= TRUSTED]
    return [special for _, special in _forks_once(found + at_minus_one(curve, probes, arcs))]


def _arcs(curve: CycleCurve, points: list[Point]) -> list[float]:
    """Return the length of arc of each point."""
    arcs: list[float] = np.cumsum([0.0, *(distance(curve, a, b) for a, b in pairwise(points))]).tolist()
    return arcs


def _at(known: SpecialPoint, probe: Probe) -> SpecialPoint:
    """Return the special point at which a curve begins, with the cycle of the curve where it passes through."""
    return replace(known, orbit=probe.orbit) if known.kind in ("pitchfork", "branch point") else known


def _touching(curve: CycleCurve, probes: list[Probe]) -> list[Located]:
    """Return the grazing with which a curve begins, where linear cycles end and a gap closes."""
    if len(probes) < 2:
        return []
    first, second = probes[0].contacts, probes[1].contacts
    contacts = [
        _Contact(0.0, k, second[k][1] > 0, probes[0], 0.0)
        for k in first
        if abs(first[k][1]) <= TOUCHING < abs(second[k][1])
    ]
    return [(0.0, _grazing(curve, contacts))] if contacts else []


def _changes(
    curve: CycleCurve,
    probes: list[Probe],
    arcs: list[float],
    kinds: Sequence[Kind],
    known: Mapping[int, SpecialPoint],
) -> list[Located]:
    """Return where test functions change their sign, with the length of arc.

    Next to the special point at which the curve begins no further branch is looked for.
    """
    found: list[Located] = []
    contacts: list[_Contact] = []
    for kind in kinds:
        sides = [float("nan") if kind == "branching" and i in known else q.side(kind) for i, q in enumerate(probes)]
        for i, j in _brackets(probes, sides, kind):
            if (change := _located(curve, probes, (i, j), kind)) is None:
                continue
            place, at, reach, flat = change
            arc = arcs[place] + distance(curve, probes[place].point, at.point)
            if not isinstance(kind, str):
                contacts.append(_Contact(arc, kind, sides[j] > 0, at, reach))
                continue
            tangents = probes[i].point.tangent, probes[j].point.tangent
            if (point := _special(curve, at, kind, tangents, reach)) is not None:
                found.append((arc, replace(point, status=point.status + FLAT * flat)))
    return found + [(group[0].length, _grazing(curve, group)) for group in _groups(contacts)]


def _forks_once(found: list[Located]) -> list[Located]:
    """Return the points without those that the Jacobian and the multipliers show both.

    Where several multipliers cross together, which only they show, theirs is kept; else the one located more closely.
    """
    forks = sorted((f for f in found if f[1].kind in ("pitchfork", "branch point")), key=lambda f: f[0])
    twice = [
        max(a, b, key=lambda f: (f[1].onward is not None, f[1].interval[1] - f[1].interval[0]))
        for a, b in pairwise(forks)
        if b[0] - a[0] < FORK and a[1].kind == b[1].kind
    ]
    return [f for f in found if not any(f is other for other in twice)]


def _brackets(probes: list[Probe], values: list[float], kind: Kind) -> list[tuple[int, int]]:
    """Return the places between which a test function changes its sign.

    They are neighbours but for points in between where the function is none to speak of: the point itself, or a
    stretch along which the parameter hardly varies. Where there is no sign to either side there is no change: cycles
    of a linear or conservative system.
    """
    smallest = TOUCHING if isinstance(kind, tuple) else VERTICAL if kind == "fold" else 0.0
    changes, last = [], -1
    for i, value in enumerate(values):
        if np.isnan(value):
            last = -1
        elif abs(value) > smallest:
            if last >= 0 and values[last] * value < 0 and _comparable(probes[last : i + 1], values[last : i + 1], kind):
                changes.append((last, i))
            last = i
    return changes


def _comparable(probes: list[Probe], values: list[float], kind: Kind) -> bool:
    """Tell whether the signs of a test function at the first and the last of some points are to be compared.

    A family of cycles along which the parameter does not vary ends in a small one, where the tangent is round-off:
    over points with no slope to speak of the parameter must turn back by more than its error.
    """
    if kind != "fold" or len(probes) == 2:
        return True
    y = [float(probe.point.u[-1]) for probe in probes]
    flattest = y[int(np.argmin(np.abs(values)))]
    return all((y[k] - flattest) * np.sign(values[-1]) > probes[k].value_error for k in (0, -1))


@dataclass(frozen=True, eq=False)
class _Contact:
    """A contact (element, gap) that begins to close, or ceases to, at a length of arc."""

    length: float
    kind: tuple[str, int]
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
    curve: CycleCurve, probes: list[Probe], change: tuple[int, int], kind: Kind
) -> tuple[int, Probe, float, bool] | None:
    """Locate a change of sign of a test function.

    Returns
    -------
    place, probe, reach, flat : int, Probe, float, bool
        The last point before, the point, by how much the parameter may be off, and whether that is because the
        function is round-off over several points. None where it is a jump, or cannot be followed.
    """
    i, j = change
    values = {k: probes[k].value(kind) for k in range(i, j + 1)}
    steps = [k for k in range(i, j) if values[k] * values[k + 1] <= 0]
    ends, a, b = (values[i], values[j]), probes[steps[0]], probes[steps[0] + 1]
    probes_at = {id(a.point): a, id(b.point): b}

    def test(point: Point) -> float:
        if id(point) not in probes_at:
            (probes_at[id(point)],) = probes_of(curve, [point], a.judge, a.polish)
        return probes_at[id(point)].value(kind)

    found = located(curve, a.point, b.point, test)
    if found is None:
        return None
    at, error = probes_at[id(found[0])], found[1]
    # next to a crossing branch a point may be off its own by the root of what is tolerated
    off = curve.tolerance**0.5 if kind == "branching" else 0.0
    if not abs(at.value(kind)) <= max(ZERO * min(map(abs, ends)), off, 1e-9):
        return None
    error += off
    if kind != "branching":
        error += curve.inaccuracy(at.point, at.point.error)
    # where branches cross the tangent is any in their plane: those of the neighbours tell how the parameter goes
    points = (a.point, b.point) if kind == "branching" else (at.point,)
    along = max(abs(float(point.tangent[-1])) for point in points) * float(curve.scale[-1])
    value = float(at.point.u[-1])
    flat = [q.point.u[-1] for q in probes[steps[0] : steps[-1] + 2]] if steps[-1] - steps[0] > 1 else []
    reach = max([error * along, 1e-12 * abs(value), *(abs(float(y) - value) for y in flat)])
    if kind == "fold":  # along the branch its value hardly changes, across it does
        reach = max(reach, at.value_error)
    return steps[0], at, reach, bool(flat)


def _special(
    curve: CycleCurve, at: Probe, kind: str, tangents: tuple[Array, Array], reach: float
) -> SpecialPoint | None:
    """Return the special point of a located change of sign; None where it is nothing."""
    orbit, value = at.orbit, float(at.point.u[-1])
    onward, extremum = None, ""
    if kind == "fold":
        rises = tangents[1][-1] > 0
        name, extremum, extreme = kind, "minimum" if rises else "maximum", "smallest" if rises else "largest"
        status = (
            f"{extreme} value of {curve.parameter} along the branch; slope {at.point.tangent[-1]:.1e} where located"
        )
    else:
        onward = crossing(curve, at.point, tangents[0] + tangents[1])
        breaks = orbit.is_odd(NEARLY_ODD) and not onward.is_odd(NEARLY_ODD)
        name, what = ("pitchfork", "the symmetry breaks") if breaks else ("branch point", "another branch crosses")
        status = f"{what}; smallest singular value {abs(at.value(kind)):.1e} where located"
    s = orbit.stability
    if s is not None and kind != "fold" and s.trivial_error > TRUSTED:
        status += f"; the cycle is not resolved, its trivial multiplier is off by {s.trivial_error:.1g}"
    interval = value - reach, value + reach
    return SpecialPoint(name, curve.parameter, value, interval, orbit, status, onward, extremum=extremum)


def _doubted(curve: CycleCurve, fold: SpecialPoint) -> SpecialPoint:
    """Return a fold with a status that says why it may be none."""
    doubt = doubt_on_branch(curve.equations.system, fold)
    return replace(fold, status=f"{fold.status}; {doubt}") if doubt else fold


def _grazing(curve: CycleCurve, contacts: list[_Contact]) -> SpecialPoint:
    """Return the point where contacts begin or cease to close."""
    at, reach = contacts[0].probe, contacts[0].reach
    gaps: dict[str, list[str]] = {}
    for c in contacts:
        what = "begins to touch" if c.closes else "touches for the last time"
        gaps.setdefault(f"{c.kind[0]} {what}", []).append(f"{at.contacts[c.kind][0]:g}")
    status = "; ".join(f"{what} at {' and '.join(levels)}" for what, levels in gaps.items())
    value = float(at.point.u[-1])
    return SpecialPoint("grazing", curve.parameter, value, (value - reach, value + reach), at.orbit, status)
