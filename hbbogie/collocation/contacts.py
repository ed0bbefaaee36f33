"""Contact times of piecewise-linear laws as points of the mesh, so that polynomials have no kink inside an interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.cycle import cycle_of
from hbbogie.collocation.equations import OnMesh
from hbbogie.stability.variation import Waveforms

Array = NDArray[np.float64]
MET = 1e-12  # distance of a contact time from a point of the mesh, as a share of the period, up to which it is there


def contact_times(equations: OnMesh, u: Array) -> Array:
    """Return when contacts change their lines along a solution, as shares of the period; none in a smooth system."""
    system = equations.rates.system
    if not equations.rates.kinked:
        return np.empty(0)
    values, T, _ = equations.unpack(u)
    p = equations.parameters(u)
    at = dict(zip(system.parameter_names, map(float, p), strict=True))
    orbit = cycle_of(system, equations.mesh, values, T, at, equations.advance).orbit()
    return Waveforms(system, [orbit], p[None]).switchings()[0] / (2 * np.pi)


def met(mesh: Array, times: Array) -> bool:
    """Tell whether every one of some times is a point of the mesh."""
    return bool((np.abs(mesh[:, None] - times).min(axis=0) <= MET).all()) if len(times) else True


def through(mesh: Array, times: Array) -> Array:
    """Return the mesh with points at some times: the nearest ones moved there, or new ones where these are taken."""
    mesh, taken = mesh.copy(), {0, len(mesh) - 1}
    added = []
    for time in times:
        k = int(np.argmin(np.abs(mesh - time)))
        if abs(mesh[k] - time) <= MET:
            continue
        if k in taken:
            added.append(time)
        else:
            mesh[k] = time
            taken.add(k)
    return np.sort(np.append(mesh, added))
