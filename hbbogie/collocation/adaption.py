"""Points of a branch of collocated cycles carried over to other meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.contacts import through_contacts
from hbbogie.collocation.curve import OnMeshCurve, lifted
from hbbogie.collocation.equations import OnMesh
from hbbogie.collocation.solving import FIRST, MOST, SETTLING, adapted
from hbbogie.solving.arclength import advance, correct, product
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
RESIDUAL = 1e-7  # largest scaled residual from which one more step of Newton is taken
AIM = 0.03  # share of the tolerance that the error of a new mesh should have
ROUND = 8  # multiples of it are numbers of intervals, so that compiled functions are used again
NEARLY, CLOSE = 1e-4, 1e-7  # steps after which contact times are right to their squares: nearly, and so that they stay
FARTHEST, SHRINKING = 2.0, 0.9  # largest scaled step towards contact times, and ratio to the last from the third
SECANTS, MET = 40, 1e-10  # steps towards a special point, and the length of the last
Placed = tuple[OnMeshCurve, Point]
FLOOR = 1e-2  # size of the smallest cycle, relative to the largest, in which it is scaled


def curve_at(equations: OnMesh, u: Array, interval: tuple[float, float], longest: float, largest: Array) -> OnMeshCurve:
    """Return the curve through a point, scaled by the range of its cycle."""
    ranges = np.ptp(equations.unpack(u)[0], axis=(0, 1))
    largest = np.maximum(largest, ranges)
    scaled = replace(equations.at_phase(u), size=np.maximum(ranges, FLOOR * largest))
    return OnMeshCurve(scaled, interval, longest, largest, RESIDUAL)


def adapted_to(curve: OnMeshCurve, point: Point, N: int, fixed: int | None = None) -> tuple[OnMeshCurve, Point] | None:
    """Return the point on a new mesh of N intervals, its tangent in the same direction; None where it is lost.

    It is looked for across the tangent, or with one of its last two unknowns, by its place from the end, as it is.
    Contact times become points of the mesh; a time that is off by a little moves the motion by the square of that.
    """
    equations, u = adapted(curve.equations, point.u, N)
    kinked = equations.rates.kinked
    size = np.inf if kinked else 0.0  # of the last step
    for count in range(SETTLING):
        there, along = _onto(curve, point, equations, u)
        plane = along
        if fixed is not None:
            plane = np.zeros(len(u))
            plane[fixed] = 1.0
        plane, before = plane / np.linalg.norm(plane), u
        if size <= NEARLY:
            found, _ = correct(there, u, plane)
            if found is None:
                return None
            u = found.u
            size = float(np.abs((u - before) / there.scale).max())
            if not kinked or size <= CLOSE:
                return there, found if found.tangent @ along >= 0 else found.turned()
        else:
            line = there.linearise(u)
            try:
                step, _ = line.solve(plane, -np.append(line.residual, 0.0))
            except np.linalg.LinAlgError:
                return None
            last, size = size, float(np.abs(step).max())
            if not size <= (FARTHEST if count < 2 else SHRINKING * last):
                return None
            u = u + there.scale * step
        mesh, equations = through_contacts(there.equations, u), there.equations
        if mesh is None:
            size = 0.0  # all contact times are points of the mesh
        else:
            equations, u = equations.moved(mesh, equations.m, u)
    return None


def _onto(curve: OnMeshCurve, point: Point, equations: OnMesh, u: Array) -> tuple[OnMeshCurve, Array]:
    """Return the curve on another mesh, scaled there, and the row that belongs to the tangent of a point on the old."""
    old, there = curve.equations, curve_at(equations, u, curve.interval, curve.longest, curve.largest)
    ratio = np.append(np.tile(old.size / there.equations.size, equations.N * (old.m + 1)), [1.0, 1.0])
    return there, lifted(old, point.tangent, equations.mesh, old.m) * ratio


def error_at(curve: OnMeshCurve, point: Point) -> float:
    """Return the estimated error of the period, of the states where intervals begin and of the parameter."""
    period, states, _, parameter = curve.estimate(point)[0]
    return max(period, states, parameter)


def refined(curve: OnMeshCurve, point: Point, tolerance: float, near: Point | None = None) -> Placed | None:
    """Return the point on an adapted mesh that meets the tolerance, if it can be; None where it is lost.

    The mesh fits ``near``, a point before, where that is given. How many intervals that takes follows from the order of
    the error, 2 m. Where more of them do not halve it, it is round-off, as of a small cycle about a large mean.
    """
    N, found, least = curve.equations.N, None, np.inf
    order = 2 * curve.equations.m
    N = _enough(N, order, error_at(curve, near or point) / tolerance, max(N // 2, FIRST))
    while N <= MOST and least > tolerance:
        there, error = adapted_to(curve, point, N), np.inf
        if there is not None:
            error = error_at(*there)
            if error > 0.5 * least:
                break
            found, least = there, error
        elif curve.equations.rates.kinked:
            break  # the contacts change by too much, on any mesh
        N = _enough(N, order, error / tolerance, N + ROUND)
    return found


def _enough(N: int, order: int, excess: float, fewest: int) -> int:
    """Return the number of intervals, at most twice those given, with which errors of an order meet a tolerance."""
    wanted = N * float(np.clip(excess / AIM, 0.0, 2.0**order)) ** (1 / order)
    return int(np.clip(ROUND * np.ceil(wanted / ROUND), fewest, max(2 * N, fewest)))


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
        whole = product(ends[0][0], ends[0][1].tangent, chord(ends[0], ends[1], ends[0][0].equations))
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
    there, _ = advance(curve.predicting(), point, length)
    return None if there is None else adapted_to(curve, there, curve.equations.N)


def chord(a: Placed, b: Placed, equations: OnMesh) -> Array:
    """Return the way from one point to another in scaled unknowns on some mesh."""
    ends = [curve.equations.moved(equations.mesh, equations.m, point.u)[1] for curve, point in (a, b)]
    return np.asarray((ends[1] - ends[0]) / equations.scale)
