"""Folds of exact cycles: bordered conditions, their derivatives by matrix products, and gradients by the adjoint.

At a fold the derivative of the equations in the cycle's own unknowns, F_z, is singular, F_z v = 0 and w F_z = 0. The
condition is g = 0, where g follows from a bordered system with v and w (eq-exact-fold); its derivative is -w (F_z)_y v
(W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing, Frame, Linearised
from hbbogie.exponential import exponentials_with_derivative

Array = NDArray[np.float64]

ITERATIONS = 14
FARTHEST = 0.25  # longest step of a scaled unknown


@dataclass(frozen=True, eq=False)
class Folds:
    """B folds, or the last iterates of Newton's method on the way to them.

    Attributes
    ----------
    closing : Closing
    y : ndarray, shape (B, m + 1)
    v, w : ndarray, shape (B, m)
        Right and left null vector of the derivative in the cycle's unknowns.
    at : Linearised
        The equations at y.
    curvature : ndarray, shape (B,)
        Second derivative of the scaled parameter along v: positive at a minimum.
    error : ndarray, shape (B,)
        Largest scaled residual of all conditions.
    step : ndarray, shape (B,)
        Largest entry of the next correction.
    """

    closing: Closing
    y: Array
    v: Array
    w: Array
    at: Linearised
    curvature: Array
    error: Array
    step: Array

    def of(self, some: NDArray[np.bool_]) -> Folds:
        """Return some of the folds."""
        closing = replace(self.closing, p=self.closing.p[some], frame=self.closing.frame.of(some))
        at = replace(
            self.at,
            **{f: getattr(self.at, f)[some] for f in ("F", "J", "A", "dA", "rows", "drows", "L", "nodes")},
            E=[e[some] for e in self.at.E],
            moved=self.at.moved[:, some],
        )
        numbers = (a[some] for a in (self.curvature, self.error, self.step))
        return Folds(closing, self.y[some], self.v[some], self.w[some], at, *numbers)

    @staticmethod
    def joined(parts: list[Folds]) -> Folds:
        """Return folds with one sequence as one batch."""

        def stacked(objects: list[Any], *names: str, axis: int = 0) -> dict[str, Array]:
            return {name: np.concatenate([getattr(o, name) for o in objects], axis=axis) for name in names}

        closings, ats = [f.closing for f in parts], [f.at for f in parts]
        frame = Frame(**stacked([c.frame for c in closings], "state", "rate", "rows", "parameter"))
        at = Linearised(
            **stacked(ats, "F", "J", "A", "dA", "rows", "drows", "L", "nodes"),
            **stacked(ats, "moved", axis=1),
            E=[np.concatenate(e) for e in zip(*(at.E for at in ats), strict=True)],
        )
        closing = replace(closings[0], frame=frame, p=stacked(closings, "p")["p"])
        return Folds(closing=closing, at=at, **stacked(parts, "y", "v", "w", "curvature", "error", "step"))


def null_vectors(at: Linearised) -> tuple[Array, Array]:
    """Return right and left singular vectors of the smallest singular value of F_z, each of shape (B, m)."""
    u, _, vt = np.linalg.svd(at.J[..., :-1])
    return vt[:, -1], u[..., -1]


def fold_step(closing: Closing, y: Array, v: Array, w: Array) -> tuple[Folds, Array]:
    """Return the conditions of a fold at the unknowns y, with updated null vectors, and Newton's step."""
    B, m = len(y), closing.m
    at = closing.linearise(y)
    K = np.zeros((B, m + 1, m + 1))
    K[:, :m, :m] = at.J[..., :m]
    K[:, :m, m], K[:, m, :m] = w, v
    inverse = np.asarray(np.linalg.inv(K), dtype=np.float64)
    g, v, w = inverse[:, m, m], inverse[:, :m, m], inverse[:, m, :m]
    K[:, :m, m] = at.J[..., m]
    slope = condition_slope(closing, y, at, v, w)
    with np.errstate(divide="ignore", invalid="ignore"):  # of a parameter that has no influence
        curvature = np.einsum("bi,bi->b", slope[:, :m], v) / np.einsum("bi,bi->b", w, at.J[..., m])
    error = np.maximum(np.abs(at.F).max(axis=1), np.abs(g))
    for i in closing.sequence.touching:  # a vanishing contact satisfies the condition without a fold, so divide it out
        h = y[:, closing.n + i]
        g, slope = g / h, slope / h[:, None]
        slope[:, closing.n + i] -= g / h
    K[:, m] = slope
    right = np.concatenate([at.F, g[:, None]], axis=1)
    step = -np.linalg.solve(K, right[..., None])[..., 0]
    next_step = np.abs(step).max(axis=1)
    v = np.asarray(v / np.linalg.norm(v, axis=1)[:, None])
    w = np.asarray(w / np.linalg.norm(w, axis=1)[:, None])
    return Folds(closing, y, v, w, at, curvature, error, next_step), step


def condition_slope(closing: Closing, y: Array, at: Linearised, v: Array, w: Array) -> Array:
    """Return -w (F_z)_y v, the derivative of the fold condition in all unknowns, shape (B, m + 1)."""
    n, S, of = closing.n, closing.sequence.S, closing.sequence.of
    weights, adjoint = _adjoint(closing, y, at, w)
    moved = at.moved.swapaxes(0, 1)  # (B, S + 1, N, m + 1)
    dx = moved[..., :-1] @ v[:, None, :, None]  # along v
    dh = v[:, n:, None, None]
    A, end = at.A[:, of], at.nodes[:, 1:, :, None]
    back = adjoint[:, 1:, None] @ A
    slope = (dh * (back @ moved[:, 1:])).sum(axis=1)[:, 0]
    slope[:, n : n + S] += (back @ (dx[:, 1:] - dh * (A @ end)))[..., 0, 0]
    by_parameter = at.L @ dx[:, :-1] + dh * (at.dA[:, of] @ end)
    by_parameter = (adjoint[:, 1:, None] @ by_parameter)[..., 0, 0]
    by_parameter += weights * (at.drows[:, of, closing.sequence.events, None] @ dx[:, 1:])[..., 0, 0]
    slope[:, -1] += by_parameter.sum(axis=1)
    for i in closing.sequence.touching:  # second derivative of the conditions in _divide
        J, share = at.J[:, n + i], w[:, n + i] / y[:, n + i]
        slope -= (share * v[:, n + i])[:, None] * J
        slope[:, n + i] -= share * np.einsum("bi,bi->b", J[:, :-1], v)
    return -slope


def _adjoint(closing: Closing, y: Array, at: Linearised, w: Array) -> tuple[Array, Array]:
    """Return the weights of the undivided conditions, shape (B, S), and the adjoint states, shape (B, S + 1, N)."""
    n, S, sequence = closing.n, closing.sequence.S, closing.sequence
    weights = w[:, n:].copy()
    for i in sequence.touching:
        weights[:, i] /= y[:, n + i]
    for i in sequence.touching:
        weights[:, i - 1] -= w[:, n + i] / y[:, n + i]
    adjoint = np.zeros((len(y), S + 1, closing.model.N))
    adjoint[:, 1:] = weights[..., None] * at.rows[:, sequence.of, sequence.events]
    adjoint[:, S, :n] += w[:, :n]
    for i in range(S - 1, -1, -1):
        adjoint[:, i] += (adjoint[:, i + 1, None] @ at.E[-1][:, i])[:, 0]
    return weights, adjoint


def gradients(folds: Folds) -> Array:
    """Return the derivative of the parameter's value at each fold in all parameters, shape (B, number of parameters).

    The entry of the parameter itself is -1.
    """
    slopes = pulled_back(folds.closing, folds.y, folds.at, folds.w)
    return np.asarray(-slopes / slopes[:, [folds.closing.place]])


def pulled_back(closing: Closing, y: Array, at: Linearised, w: Array) -> Array:
    """Return w F_p, the derivative of weighted equations in all parameters, shape (B, number of parameters).

    The adjoint takes one derivative of an exponential for each phase, whatever the number of parameters.
    """
    sequence, frame, of = closing.sequence, closing.frame, closing.sequence.of
    B, S, U, n = len(y), sequence.S, len(sequence.states), closing.n
    weights, adjoint = _adjoint(closing, y, at, w)
    dyads = adjoint[:, 1:, :, None] * at.nodes[:, :-1, None, :]
    of_phase = np.arange(S)
    A = at.A[:, of].swapaxes(-1, -2)
    _, by_matrix = exponentials_with_derivative(A, dyads, of_phase, y[:, n : n + S])
    by_row = np.zeros((B, S, *at.rows.shape[2:]))
    by_row[:, of_phase, sequence.events] = weights[..., None] * at.nodes[:, 1:]
    member = (of == np.arange(U)[:, None]).astype(float)
    by_matrix, by_row = (np.einsum("us,bsij->buij", member, a) for a in (by_matrix, by_row))
    by_matrix *= frame.matrix_scale
    by_row *= frame.row_scale
    p = np.repeat(closing.parameters(y), U, axis=0)
    sides, shape = np.tile(sequence.states, (B, 1)), (B * U, *by_matrix.shape[2:])
    slopes = closing.model.pulled_back(sides, p, by_matrix.reshape(shape), by_row.reshape(B * U, *by_row.shape[2:]))
    return slopes.reshape(B, U, -1).sum(axis=1)


def shifts(folds: Folds) -> Array:
    """Return the derivative of the unknowns of the first fold in all parameters, up to a multiple of v.

    Returns
    -------
    ndarray, shape (m + 1, number of parameters)
    """
    closing, m, one = folds.closing, folds.closing.m, np.zeros(folds.closing.m, dtype=int)
    many = replace(closing, p=closing.p[one], frame=closing.frame.of(one))
    y = folds.y[one]
    by_parameters = pulled_back(many, y, many.linearise(y), np.eye(m))
    value = gradients(folds)[0] / closing.frame.parameter[0]
    value[closing.place] = 0.0
    by_parameters[:, closing.place] = 0.0
    J = folds.at.J[0]
    right = -(by_parameters + J[:, -1:] * value)
    return np.vstack([np.linalg.lstsq(J[:, :m], right, rcond=1e-9)[0], value])


def fold_of(closing: Closing, y: Array, tolerance: float = 1e-11) -> Folds:
    """Return folds by Newton's method from the unknowns y, shape (B, m + 1); ``error`` tells whether it converged."""
    v, w = null_vectors(closing.linearise(y))
    for _ in range(ITERATIONS):
        found, step = fold_step(closing, y, v, w)
        v, w = found.v, found.w
        done = (found.error <= tolerance) & (found.step <= 1e-9)
        if done.all():
            return replace(found, y=y + step)
        if not np.isfinite(step).all():
            break
        y = y + step * np.minimum(1.0, FARTHEST / np.maximum(found.step, 1e-300))[:, None]
    return found
