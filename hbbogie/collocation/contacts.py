"""Contact times of piecewise-linear laws as points of the mesh, so that polynomials have no kink inside an interval."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

from hbbogie.collocation.equations import OnMesh
from hbbogie.polynomials import evaluated, gauss, within

Array = NDArray[np.float64]
MET = 1e-12  # distance of a contact time from a point of the mesh, as a share of the period, up to which it is there
SETTLED = 1e-12  # change of the scaled unknowns below which contact times are right, as of one that only just touches
FINE = 8  # parts of an interval in each of which a contact is looked for
SECANTS, SAME = 12, 1e-15  # steps towards a contact time, and the last in shares of the interval


def contact_times(equations: OnMesh, u: Array) -> Array:
    """Return when contacts change their lines along a solution, as shares of the period; none in a smooth system."""
    if not equations.rates.kinked:
        return np.empty(0)
    N, m, mesh = equations.N, equations.m, equations.mesh
    states = equations.unpack(u)[0].reshape(-1, equations.n)
    depths = equations.rates.depths(states, equations.parameters(u)).reshape(N, m + 1, -1)  # polynomials, too
    fine = within(m, FINE) @ depths
    d = np.concatenate([fine.reshape(N * FINE, -1), fine[:1, 0]])
    s = np.append((mesh[:-1, None] + np.diff(mesh)[:, None] * np.arange(FINE) / FINE).ravel(), 1.0)
    # a short contact lies about the vertex of the parabola through three points
    k, ramp = np.nonzero((d[1:-1] - d[:-2]) * (d[2:] - d[1:-1]) < 0)
    left, right = s[k + 1] - s[k], s[k + 2] - s[k + 1]
    before, after = (d[k + 1, ramp] - d[k, ramp]) / left, (d[k + 2, ramp] - d[k + 1, ramp]) / right
    vertices = s[k + 1] - 0.5 * (left + before * (left + right) / (after - before))
    nodes = np.append(s, np.clip(vertices, s[k], s[k + 2]))
    order = np.argsort(nodes)
    d = np.concatenate([d, evaluated(mesh, depths, nodes[len(s) :])])[order]
    nodes = nodes[order]
    k, ramp = np.nonzero((d[:-1] > 0) != (d[1:] > 0))
    return np.unique(_roots(mesh, depths, ramp, nodes[k], nodes[k + 1]))


def _roots(mesh: Array, depths: Array, ramp: NDArray[np.int_], low: Array, high: Array) -> Array:
    """Return where depths vanish between two times in an interval, by secants that keep it between them (Illinois)."""
    if not len(ramp):
        return low
    g, h = gauss(depths.shape[1] - 1), np.diff(mesh)
    i = np.clip(np.searchsorted(mesh, low, side="right") - 1, 0, len(h) - 1)
    coefficients = g.to_legendre @ depths[i, :, ramp].T
    ends = [(low - mesh[i]) / h[i], (high - mesh[i]) / h[i]]
    values = [legval(2 * theta - 1, coefficients, tensor=False) for theta in ends]
    middle = ends[0]
    for _ in range(SECANTS):
        last, difference = middle, values[0] - values[1]
        share = np.divide(values[0], difference, out=np.zeros_like(low), where=difference != 0)
        middle = ends[0] + np.clip(share, 0.0, 1.0) * (ends[1] - ends[0])
        if np.abs(middle - last).max() <= SAME:
            break
        value = legval(2 * middle - 1, coefficients, tensor=False)
        first = (value > 0) == (values[0] > 0)
        values = [np.where(first, value, 0.5 * values[0]), np.where(first, 0.5 * values[1], value)]
        ends = [np.where(first, middle, ends[0]), np.where(first, ends[1], middle)]
    return np.asarray(mesh[i] + h[i] * middle)


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
