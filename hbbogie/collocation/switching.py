"""From a branch point or a period doubling to the branch that begins there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.equations import OnMesh
from hbbogie.collocation.special import Special, judged
from hbbogie.solving.arclength import correct, product

Array = NDArray[np.float64]
STEPS = (0.02, 0.005, 0.1)  # distances from the special point, relative to the range of the motion, tried in turn


def onward(special: Special) -> CollocatedCycle | None:
    """Return a cycle on the branch that begins at a special point; None where none is found.

    At a period doubling it is looked for on the mesh passed twice. In these unknowns two branches cross at the point.
    Bordered by the direction of the known one the equations are singular but for the error with which the point is
    located, so that the solution for any right-hand side has the direction of the other. The known one is the chord
    between the points beside it, since the tangent is not determined where branches cross.
    """
    curve, point = special.curve, special.point
    twice = 2 if special.kind == "period doubling" else 1
    equations, u, tangent = _passed(curve.equations, point.u, special.chord, twice)
    there = OnMeshCurve(equations, curve.interval, twice * curve.longest, curve.largest, curve.tolerance)
    right = np.append(np.random.default_rng(0).normal(size=len(u) - 1), 0.0)
    try:
        direction, _ = equations.linearise(u).solve(there.weights * tangent, right)
    except np.linalg.LinAlgError:
        return None
    direction = direction / product(there, direction, direction) ** 0.5
    for step in STEPS:
        found, _ = correct(there, u + step * there.scale * direction, there.weights * direction)
        if found is not None:
            return judged(there, found)
    return None


def _passed(equations: OnMesh, u: Array, tangent: Array, times: int) -> tuple[OnMesh, Array, Array]:
    """Return the equations, unknowns and tangent of a cycle that is passed several times in a period."""
    values, T, parameter = equations.unpack(u)
    mesh = np.append(np.concatenate([(k + equations.mesh[:-1]) / times for k in range(times)]), 1.0)
    values = np.tile(values, (times, 1, 1))
    sides = None if equations.sides is None else np.tile(equations.sides, (times, 1))
    there = replace(equations, mesh=mesh, reference=values, sides=sides)
    stages, states, last = np.split(tangent, [equations.N * equations.m * equations.n, len(tangent) - 2])
    return there, there.pack(values, times * T, parameter), np.concatenate([*[stages] * times, *[states] * times, last])
