"""Where a branch of collocated cycles crosses a value of the parameter or its own start, and where it goes on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.adaption import Placed, located_between
from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.special import Special, judged
from hbbogie.collocation.starting import Sampled
from hbbogie.polynomials import points_of
from hbbogie.solving.arclength import gap, towards
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
REACH = 2.0  # by which the parameter may go on along a tangent, in lengths of the step to the next point
ON_STEP = 0.1  # distance from a step, in units of its length, up to which a point is on it


def reaches(curve: OnMeshCurve, points: Sequence[Point], value: float) -> bool:
    """Tell whether the parameter may have a value between points, by the tangents of each two."""
    for a, b in pairwise(points):
        ahead = REACH * gap(curve, a, b) * curve.scale[-1]
        ends = (a.u[-1], b.u[-1], a.u[-1] + ahead * a.tangent[-1], b.u[-1] - ahead * b.tangent[-1])
        if min(ends) <= value <= max(ends):
            return True
    return False


def crossings_of(points: list[Placed], folds: list[Special], value: float) -> Iterator[tuple[int, CollocatedCycle]]:
    """Yield the cycles at a value of the parameter among points on their own meshes, with the folds before each."""
    part = 0
    for k, (a, b) in enumerate(pairwise(points)):
        inside = [(fold.curve, fold.point) for fold in folds if fold.place == k]
        for i, (here, there) in enumerate(pairwise([a, *inside, b])):
            part += i > 0
            low, high = sorted((here[1].u[-1], there[1].u[-1]))
            if low <= value < high:
                yield part, judged(*located_between(here, there, partial(_beyond, value))[0])


def _beyond(value: float, curve: OnMeshCurve, point: Point) -> float:
    return off(value, point)


def off(value: float, point: Point) -> float:
    """Return how far the parameter of a point is from a value."""
    return float(point.u[-1]) - value


def away_from(curve: OnMeshCurve, point: Point, before: Sampled) -> Point:
    """Return a point with its tangent turned away from a cycle before it, which is in the same phase."""
    e = curve.equations
    s = points_of(e.mesh, e.m)
    values = before.states(s.ravel()).reshape(*s.shape, -1)
    last = e.pack(values, before.period, before.parameters[curve.parameter])
    return towards(curve, point, (point.u - last) / curve.scale)


def signature(curve: OnMeshCurve, point: Point) -> Array:
    """Return what tells cycles apart: scaled parameter, log T, smallest and largest values, shape (2 + 2 n_states,)."""
    values = curve.equations.unpack(point.u)[0]
    ends = [values.min(axis=(0, 1)), values.max(axis=(0, 1))]
    return np.concatenate([[point.u[-1] / curve.equations.width, point.u[-2]], *ends])


def closes(start: Array, second: Array, marks: list[Array], largest: Array) -> bool:
    """Tell whether a branch comes back to its start, in the same direction: that lies on one of the last steps."""
    size = np.concatenate([[1.0, 1.0], largest, largest])
    start, second, marks = start / size, second / size, [mark / size for mark in marks]
    for here, there in pairwise(marks):
        step, way = there - here, start - here
        share = np.clip(float(way @ step) / max(float(step @ step), 1e-300), 0.0, 1.0)
        if np.linalg.norm(way - share * step) <= ON_STEP * np.linalg.norm(step) and step @ (second - start) > 0:
            return True
    return False
