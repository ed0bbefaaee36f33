"""Where multipliers cross the unit circle, located: period doublings, tori, pitchforks, and how many cross together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from hbbogie.branches.bifurcation_tests import MARGIN, Probe, probes_of
from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.branches.multiplier_paths import Crossing, crossings_of, followed, logarithms, neutral_within
from hbbogie.branches.switching import asymmetric, doubled
from hbbogie.results import SpecialPoint
from hbbogie.solving.arclength import distance, located
from hbbogie.solving.curve import Point
from hbbogie.stability.crossing import description

Located = tuple[float, SpecialPoint]  # with the length of arc
SAME = 1e-6  # length of arc within which two points are one
REAL = 1e-4  # angle up to which a multiplier is at 1 or at -1: where two meet they part by the root of their error
ON_CIRCLE = 1e-6  # distance from the unit circle up to which multipliers cross together
ZERO = 1e-2  # where a multiplier is located on the circle its logarithm has fallen by this much, else it jumps
BESIDE = 2  # points by which a multiplier of a cycle that is not resolved may pass 1 beside the point that explains it
EXPLAIN = ("fold", "branch point", "pitchfork")  # points of the equations at which a multiplier is 1


def with_multipliers(
    curve: CycleCurve, probes: list[Probe], arcs: list[float], found: list[Located], known: Iterable[int]
) -> list[Located]:
    """Return the points found, and where multipliers cross the unit circle that those do not explain.

    Parameters
    ----------
    curve : CycleCurve
    probes : list of Probe
    arcs : list of float
        Length of arc of each.
    found : list of (float, SpecialPoint)
        What the equations themselves have shown: a fold or a branch point explains one multiplier that passes 1. Where
        that passes 1 elsewhere, because the cycles are not resolved, the interval of the point is widened.
    known : iterable of int
        Places of special points at which the curve begins.
    """
    found, free = list(found), [k for k, (_, s) in enumerate(found) if s.kind in EXPLAIN]
    points: list[tuple[float, SpecialPoint, Probe]] = []
    lost: dict[tuple[int, int], list[tuple[Crossing, str]]] = {}

    def explained(first: int, last: int) -> int | None:
        """Return the place of a point between two others that explains a crossing, and explains no other then."""
        low, high = arcs[max(first, 0)] - SAME, arcs[min(last, len(arcs) - 1)] + SAME
        place = next((k for k in free if low <= found[k][0] <= high), None)
        if place is not None:
            free.remove(place)
        return place

    for crossing in sorted(crossings_of(probes), key=lambda c: not c.positive):
        i, j = crossing.places[0], crossing.places[-1]
        if any(i <= k <= j for k in known) or (crossing.positive and explained(i, j) is not None):
            continue
        near = [(at, s.kind) for arc, s, at in points if arcs[i] - SAME <= arc <= arcs[j] + SAME]
        if any(_among(at, kind, crossing, probes) for at, kind in near):
            continue
        where, why = _located(curve, probes, crossing), "take more harmonics or shorter steps"
        if where is not None:
            place, at, log, reach = where
            arc = arcs[place] + distance(curve, probes[place].point, at.point)
            special = _special(curve, at, log, reach)
            if special is not None:
                if not any(s.kind == special.kind and abs(arc - other) <= SAME for other, s, _ in points):
                    points.append((arc, special, at))
                continue
            value = float(at.point.u[-1])
            if (k := explained(i - BESIDE, j + BESIDE)) is not None:
                found[k] = found[k][0], _widened(found[k][1], value)
                continue
            why = f"a multiplier passes 1 at {curve.where(at.point.u)}, where the equations have neither a fold nor a "
            why += "branch point: take more harmonics"
        lost.setdefault((i, j), []).append((crossing, why))
    away = [(arcs[j], _lost(curve, probes[i : j + 1], of)) for (i, j), of in lost.items()]
    return [*found, *((arc, special) for arc, special, _ in points), *away]


def at_minus_one(curve: CycleCurve, probes: list[Probe], arcs: list[float]) -> list[Located]:
    """Return where a real multiplier passes -1, of half a period or of a whole one: pitchforks and period doublings."""
    found: list[Located] = []
    for crossing in crossings_of(probes):
        step = crossing.step()
        if step is None or not all(np.pi - abs(log.imag) <= REAL for log in step[2:]):
            continue
        if (where := _located(curve, probes, crossing)) is None:
            continue
        place, at, log, reach = where
        arc = arcs[place] + distance(curve, probes[place].point, at.point)
        special = _special(curve, at, log, reach)
        if special is not None and not any(abs(arc - other) <= SAME for other, _ in found):
            found.append((arc, special))
    return found


def _widened(point: SpecialPoint, value: float) -> SpecialPoint:
    """Return a point of the equations with an interval that holds the value at which the multiplier passes 1."""
    status = f"{point.status}; the cycles are not resolved there: the multiplier passes 1 at {value:.6g}"
    low, high = point.interval
    return replace(point, interval=(min(low, value), max(high, value)), status=status)


def _among(at: Probe, kind: str, crossing: Crossing, probes: list[Probe]) -> bool:
    """Tell whether a multiplier is one of those that cross at a point located already."""
    if (step := crossing.step()) is None:
        return False
    log = followed(probes[step[0]], step[2], at)
    return (_kind(log, at) or "branch point") == kind and abs(log.real) <= _together(at)


def _together(at: Probe) -> float:
    return max(neutral_within(at), ON_CIRCLE)


def _kind(log: complex, at: Probe) -> str:
    """Return what happens where a multiplier with this logarithm crosses the unit circle; empty at 1."""
    if abs(log.imag) <= REAL:
        return ""
    if abs(log.imag) < np.pi - REAL:
        return "Neimark-Sacker"
    return "pitchfork" if at.half else "period doubling"


def _located(curve: CycleCurve, probes: list[Probe], crossing: Crossing) -> tuple[int, Probe, complex, float] | None:
    """Return the place before, the point, the multiplier's logarithm and by how much the parameter may be off."""
    if (step := crossing.step()) is None:
        return None
    i, j, log, after = step
    a, b = probes[i], probes[j]
    # where two real ones become a pair, or a pair two, the real one tells which is meant
    reference, log = (b, after) if log.imag % np.pi and not after.imag % np.pi else (a, log)
    probes_at = {id(a.point): a, id(b.point): b}

    def test(point: Point) -> float:
        if id(point) not in probes_at:
            (probes_at[id(point)],) = probes_of(curve, [point], a.judge, a.polish)
        return followed(reference, log, probes_at[id(point)]).real

    found = located(curve, a.point, b.point, test)
    if found is None:
        return None
    at, ends = probes_at[id(found[0])], (test(a.point), test(b.point))
    there, stability = followed(reference, log, at), at.orbit.stability
    if stability is None or not abs(there.real) <= max(ZERO * min(map(abs, ends)), 1e-9, neutral_within(at)):
        return None
    slope = abs(ends[1] - ends[0]) / distance(curve, a.point, b.point)
    error = found[1] + curve.inaccuracy(at.point, at.point.error) + MARGIN * stability.trivial_error / slope
    along = abs(float(at.point.tangent[-1])) * float(curve.scale[-1])
    return i, at, there, max(error * along, 1e-12 * abs(float(at.point.u[-1])))


def _special(curve: CycleCurve, at: Probe, log: complex, reach: float) -> SpecialPoint | None:
    """Return the special point at which a multiplier crosses; None where a single one passes 1."""
    logs, kind = logarithms(at), _kind(log, at)
    assert logs is not None  # the point was located by them
    together = [m for m in logs if abs(m.real) <= _together(at) and _kind(m, at) == kind]
    if kind == "Neimark-Sacker":
        together = [m for m in together if m.imag > 0]
    count = max(len(together), 1)
    if not kind and count < 2:
        return None
    system, onward = curve.equations.system, None
    many = f"{count} multipliers cross together" if kind != "Neimark-Sacker" else f"{count} pairs cross together"
    if kind in ("pitchfork", "period doubling") and count == 1:
        onward = (asymmetric if at.half else doubled)(system, at.cycle)
    kind = kind or "branch point"
    what = description(kind, complex(np.exp(log)), bool(at.half))
    status = f"{what}; {many}" if count > 1 else what
    value = float(at.point.u[-1])
    return SpecialPoint(kind, curve.parameter, value, (value - reach, value + reach), at.orbit, status, onward)


def _lost(curve: CycleCurve, probes: list[Probe], of: list[tuple[Crossing, str]]) -> SpecialPoint:
    """Return what says where multipliers cross and are not located."""
    values = [float(q.point.u[-1]) for q in probes]
    out = sum(crossing.outward for crossing, _ in of)
    ways = [f"{n} multiplier(s) {way} the unit circle" for n, way in ((out, "leave"), (len(of) - out, "enter")) if n]
    status = f"{' and '.join(ways)} in this interval; what happens there was not located: {of[0][1]}"
    ends = min(values), max(values)
    return SpecialPoint("not located", curve.parameter, ends[1], ends, probes[-1].orbit, status)
