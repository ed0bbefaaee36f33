"""Points of a branch of collocated cycles carried over to other meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.contacts import SETTLED, through_contacts
from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.equations import OnMesh
from hbbogie.collocation.solving import FIRST, MOST, SETTLING, adapted, errors_of
from hbbogie.polynomials import evaluated, points_of
from hbbogie.solving.arclength import advance, correct, product
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
RESIDUAL = 1e-7  # largest scaled residual from which one more step of Newton is taken
COARSER = 1e-4  # share of the tolerance below which there are too many intervals
SECANTS, MET = 40, 1e-10  # steps towards a special point, and the length of the last
Placed = tuple[OnMeshCurve, Point]
FLOOR = 1e-2  # size of the smallest cycle, relative to the largest, in which it is scaled


def curve_at(equations: OnMesh, u: Array, interval: tuple[float, float], longest: float, largest: Array) -> OnMeshCurve:
    """Return the curve through a point, scaled by the range of its cycle."""
    ranges = np.ptp(equations.unpack(u)[0], axis=(0, 1))
    largest = np.maximum(largest, ranges)
    scaled = replace(equations.at_phase(u), size=np.maximum(ranges, FLOOR * largest))
    return OnMeshCurve(scaled, interval, longest, largest, RESIDUAL)


def lifted(equations: OnMesh, tangent: Array, mesh: Array | None = None, m: int | None = None) -> Array:
    """Return the row that belongs to a tangent on another mesh, of the next degree where no other is given."""
    degree = equations.m + 1 if m is None else m
    there = replace(equations, mesh=equations.mesh if mesh is None else mesh, m=degree)
    k = equations.N * equations.m * equations.n
    stages, states = tangent[:k].reshape(equations.N, equations.m, -1), tangent[k:-2].reshape(equations.N, 1, -1)
    values = evaluated(equations.mesh, np.concatenate([states, stages], axis=1), points_of(there.mesh, degree))
    return there.weights * np.concatenate([values[:, 1:].ravel(), values[:, 0].ravel(), tangent[-2:]])


def adapted_to(curve: OnMeshCurve, point: Point, N: int, fixed: int | None = None) -> tuple[OnMeshCurve, Point] | None:
    """Return the point on a new mesh of N intervals, its tangent in the same direction; None where it is lost.

    It is looked for across the tangent, or with one of its last two unknowns, by its place from the end, as it is.
    Contact times become points of the mesh; a time that is off by a little moves the motion by the square of that.
    """
    equations, u = adapted(curve.equations, point.u, N)
    for _ in range(SETTLING):
        there, found = _across(curve, point, equations, u, fixed)
        if found is None:
            return None
        mesh = through_contacts(there.equations, found.u)
        if mesh is None or np.abs((found.u - u) / there.scale).max() <= SETTLED:
            return there, found
        equations, u = there.equations.moved(mesh, equations.m, found.u)
    return None


def _across(
    curve: OnMeshCurve, point: Point, equations: OnMesh, u: Array, fixed: int | None
) -> tuple[OnMeshCurve, Point | None]:
    """Return the curve on another mesh and its point near some unknowns, in the direction of a point of the old one."""
    old, there = curve.equations, curve_at(equations, u, curve.interval, curve.longest, curve.largest)
    ratio = np.append(np.tile(old.size / there.equations.size, equations.N * (old.m + 1)), [1.0, 1.0])
    along = lifted(old, point.tangent, equations.mesh, old.m) * ratio
    plane = along
    if fixed is not None:
        plane = np.zeros(len(u))
        plane[fixed] = 1.0
    found, _ = correct(there, u, plane / np.linalg.norm(plane))
    return there, found if found is None or found.tangent @ along >= 0 else found.turned()


def error_at(curve: OnMeshCurve, point: Point) -> float:
    """Return the estimated error of the period, of the states where intervals begin and of the parameter."""
    period, states, _, parameter = errors_of(curve.equations, point.u, lifted(curve.equations, point.tangent))[0]
    return max(period, states, parameter)


def refined(curve: OnMeshCurve, point: Point, tolerance: float) -> tuple[OnMeshCurve, Point] | None:
    """Return the point on an adapted mesh that meets the tolerance, if it can be; None where it is lost.

    Where twice the intervals do not halve the error it is round-off, as of a small cycle about a large mean.
    """
    N, found, least = curve.equations.N, None, np.inf
    if N > FIRST and error_at(curve, point) < COARSER * tolerance:
        N = max(N // 2, FIRST)
    while N <= MOST and least > tolerance:
        there = adapted_to(curve, point, N)
        if there is not None:
            error = error_at(*there)
            if error > 0.5 * least:
                break
            found, least = there, error
        elif curve.equations.rates.kinked:
            break  # the contacts change by too much, on any mesh
        N *= 2
    return found


def located_between(a: Placed, b: Placed, test: Callable[[OnMeshCurve, Point], float]) -> tuple[Placed, float]:
    """Return the point between two others, on meshes of their own, at which a function changes its sign.

    By the secant method; every point it comes to has its own contact times on the mesh.

    Returns
    -------
    (OnMeshCurve, Point)
    float
        Length of the last step in scaled arclength, or of what could not be passed: the error.
    """
    ends, values = [a, b], [test(*a), test(*b)]
    error, last = np.inf, -1
    for _ in range(SECANTS):
        whole = product(ends[0][0], ends[0][1].tangent, chord(*ends, ends[0][0].equations))
        share = float(np.clip(values[0] / (values[0] - values[1]), 1e-3, 1 - 1e-3))
        near = int(share > 0.5)
        curve, point = ends[near]
        step = whole * (share - near)
        found = _stepped(curve, point, step) or _stepped(curve, point, 0.25 * step)
        if found is None:
            return ends[near], abs(whole)
        value = test(*found)
        error = abs(step)
        if error <= MET or value == 0:
            return found, error
        side = int(value * values[1] > 0)
        ends[side], values[side] = found, value
        if side == last:  # else the other end would stay, and the steps too
            values[1 - side] /= 2
        last = side
    return ends[last], error


def _stepped(curve: OnMeshCurve, point: Point, length: float) -> Placed | None:
    """Return the point at a distance along the tangent, with its own contact times; None where it is lost."""
    there, _ = advance(curve, point, length)
    return None if there is None else adapted_to(curve, there, curve.equations.N)


def chord(a: Placed, b: Placed, equations: OnMesh) -> Array:
    """Return the way from one point to another in scaled unknowns on some mesh."""
    ends = [curve.equations.moved(equations.mesh, equations.m, point.u)[1] for curve, point in (a, b)]
    return np.asarray((ends[1] - ends[0]) / equations.scale)
