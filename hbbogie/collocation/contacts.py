"""Contact times of piecewise-linear laws as points of the mesh, so that polynomials have no kink inside an interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.cycle import cycle_of
from hbbogie.collocation.equations import OnMesh
from hbbogie.stability.variation import Waveform

Array = NDArray[np.float64]
MET = 1e-12  # distance of a contact time from a point of the mesh, as a share of the period, up to which it is there
SETTLED = 1e-12  # change of the scaled unknowns below which contact times are right, as of one that only just touches


def contact_times(equations: OnMesh, u: Array) -> Array:
    """Return when contacts change their lines along a solution, as shares of the period; none in a smooth system."""
    system = equations.rates.system
    if not equations.rates.kinked:
        return np.empty(0)
    values, T, _ = equations.unpack(u)
    p = equations.parameters(u)
    at = dict(zip(system.parameter_names, map(float, p), strict=True))
    orbit = cycle_of(system, equations.mesh, values, T, at, equations.advance).orbit()
    return Waveform(system, orbit, p).switchings() / (2 * np.pi)


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


def through_contacts(equations: OnMesh, u: Array) -> Array | None:
    """Return the mesh with a solution's own contact times as points; None where it has them and all sides are right."""
    if not equations.rates.kinked:
        return None
    times = contact_times(equations, u)
    mesh = through(equations.mesh, times)
    if len(mesh) != len(equations.mesh) or np.abs(mesh - equations.mesh).max() > 0:
        return mesh
    return None if np.array_equal(equations.sides_at(mesh, u), equations.sides) else mesh  # type: ignore[arg-type]
