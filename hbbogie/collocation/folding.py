"""Folds of collocated cycles: bordered conditions, their derivatives by the adjoint, and gradients in all parameters.

The derivative J of the equations F(u) = 0 in all unknowns u, bordered by a row, gives the tangent t, J t = 0, and the
adjoint w, w J = (0 .. 0, 1) but for the border. Where the last entry of t, that of the parameter, vanishes the two are
the null vectors of the derivative in the cycle's own unknowns (eq-collocation-fold). Its derivative is -w F_uu t
(W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.collocation.contacts import through_contacts
from hbbogie.collocation.curve import OnMeshCurve, lifted
from hbbogie.collocation.equations import OnMesh
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
ITERATIONS = 14
FARTHEST = 0.5  # longest step of a scaled unknown
SETTLED = 1e-9  # largest change of an unknown, by its weight in the distance
CANARD = 1e-4  # the same where it does not shrink any more: the parameter hardly varies along the branch


@dataclass(frozen=True, eq=False)
class Fold:
    """A fold of collocated cycles.

    Attributes
    ----------
    curve : OnMeshCurve
        Where elements are piecewise linear, with the fold's own contact times on the mesh.
    point : Point
    curvature : float
        Second derivative of the scaled parameter along the branch in scaled arclength: positive at a minimum.
    error : float
        Size of the last correction of the scaled parameter.
    """

    curve: OnMeshCurve
    point: Point
    curvature: float
    error: float

    __repr__ = brief


def fold_from(curve: OnMeshCurve, u: Array, tangent: Array) -> Fold | None:
    """Return the fold near unknowns by Newton's method; None where that does not converge.

    Parameters
    ----------
    curve : OnMeshCurve
    u : ndarray
    tangent : ndarray
        That of the curve there, more or less.
    """
    e, row, last = curve.equations, curve.weights * tangent, np.inf
    for _ in range(ITERATIONS):
        if (mesh := through_contacts(e, u)) is not None:
            row, (e, u) = lifted(e, tangent, mesh, e.m), e.moved(mesh, e.m, u)
        line = e.linearise(u)
        try:
            tangent, sign = line.solve(row, np.append(np.zeros(len(u) - 1), 1.0))
            stages, states = line.adjoint(row)
            slope = condition_slope(e, u, tangent, stages, states)
            step, _ = line.solve(slope, -np.append(line.residual, tangent[-1]))
        except np.linalg.LinAlgError:
            return None
        size = float(np.abs(e.weights * step).max())
        if not np.abs(step).max() <= FARTHEST:
            return None
        norm = float((e.weights * tangent) @ tangent) ** 0.5
        tangent = tangent / norm
        stalled = size <= CANARD and size > 0.5 * last
        if (size <= SETTLED or stalled) and np.abs(line.residual).max() <= curve.tolerance:
            there = OnMeshCurve(e.at_phase(u), curve.interval, curve.longest, curve.largest, curve.tolerance)
            point = Point(u, tangent, line.residual, sign)
            return Fold(there, point, float(slope @ tangent) / norm, abs(float(step[-1])))
        row, last = e.weights * tangent, size
        u = u + e.scale * step
    return None


def stage_weights(e: OnMesh, u: Array, stages: Array) -> Array:
    """Return the factors of the rates at the stages in the weighted equations of the stages, shape (N, m, n_states)."""
    h = np.diff(e.mesh)[:, None, None] * np.exp(u[-2])
    return np.asarray(np.einsum("ijn,jk->ikn", stages, e.gauss.a) * h / e.size)


def condition_slope(e: OnMesh, u: Array, tangent: Array, stages: Array, states: Array) -> Array:
    """Return -w F_uu t, the derivative of the parameter's share in the tangent t, in scaled unknowns.

    Where a contact changes its line the second derivative has a term at its time, which moves with the motion.

    Parameters
    ----------
    e : OnMesh
        Where elements are piecewise linear, with the contact times of u on the mesh.
    u, tangent : ndarray
    stages, states : ndarray, shape (N, m, n_states) and (N, n_states)
        The adjoint w: factors of the equations of the stages, and of those that lead on to the next interval.
    """
    values, p, n, k = e.unpack(u)[0], e.parameters(u), e.n, e.N * e.m * e.n
    along = np.empty((e.N * e.m, n + 2))
    along[:, :n] = (tangent[:k].reshape(e.N, e.m, n) * e.size).reshape(-1, n)
    along[:, n], along[:, n + 1] = tangent[-1] * e.width, tangent[-2]
    weights = stage_weights(e, u, stages).reshape(-1, n)
    bent = e.rates.bent(values[:, 1:].reshape(-1, n), p, weights, along, e.sides_of_stages)
    slope = np.zeros(len(u))
    slope[:k] = (bent[:, :n].reshape(e.N, e.m, n) * e.size).ravel()
    slope[-2:] = bent[:, n + 1].sum(), bent[:, n].sum() * e.width
    if e.sides is None:
        return slope
    ahead = np.roll(e.sides, -1, axis=0) - e.sides
    i, ramp = np.nonzero(ahead)  # at the end of interval i
    if not len(i):
        return slope
    j = (i + 1) % e.N
    x = values[j, 0]
    changes = np.zeros((len(i), e.sides.shape[1]))
    changes[np.arange(len(i)), ramp] = ahead[i, ramp]
    G, rate = e.rates.kinks(x, p, states[i] / e.size, changes, e.sides[i])
    t = np.concatenate([tangent[k:-2].reshape(e.N, n)[j] * e.size, np.full((len(i), 1), tangent[-1] * e.width)], axis=1)
    share = np.divide((G * t).sum(axis=1), rate, out=np.zeros(len(i)), where=rate != 0)
    terms = share[:, None] * G
    by_states = np.zeros((e.N, n))
    np.add.at(by_states, j, terms[:, :n] * e.size)
    slope[k:-2] += by_states.ravel()
    slope[-1] += terms[:, n].sum() * e.width
    return slope


def fold_gradient(curve: OnMeshCurve, point: Point) -> dict[str, float]:
    """Return the derivatives of a fold's value in all other parameters, by the adjoint (eq-fold-gradient)."""
    e, u = curve.equations, point.u
    stages, _ = curve.line(point).adjoint(curve.weights * point.tangent)
    weights = stage_weights(e, u, stages).reshape(-1, e.n) * e.width
    states = e.unpack(u)[0][:, 1:].reshape(-1, e.n)
    slopes = e.rates.sensitivity(states, e.parameters(u), weights, e.sides_of_stages)
    names = e.rates.system.parameter_names
    return {name: float(s) for name, s in zip(names, slopes, strict=True) if name != e.rates.parameter}
