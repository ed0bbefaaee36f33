"""Points of a branch of collocated cycles carried over to other meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.equations import OnMesh
from hbbogie.collocation.solving import FIRST, MOST, adapted, errors_of
from hbbogie.polynomials import evaluated, points_of
from hbbogie.solving.arclength import correct
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
RESIDUAL = 1e-7  # largest scaled residual from which one more step of Newton is taken
COARSER = 1e-4  # share of the tolerance below which there are too many intervals
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


def adapted_to(curve: OnMeshCurve, point: Point, N: int) -> tuple[OnMeshCurve, Point] | None:
    """Return the point on a new mesh of N intervals, its tangent in the same direction; None where it is lost."""
    old = curve.equations
    equations, u = adapted(old, point.u, N)
    there = curve_at(equations, u, curve.interval, curve.longest, curve.largest)
    ratio = np.append(np.tile(old.size / there.equations.size, N * (old.m + 1)), [1.0, 1.0])
    plane = lifted(old, point.tangent, equations.mesh, old.m) * ratio
    plane /= np.linalg.norm(plane)
    found, _ = correct(there, u, plane)
    return None if found is None else (there, found)


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
        N *= 2
    return found
