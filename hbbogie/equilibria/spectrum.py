"""Eigenvalues along a branch of equilibria, with their slopes, matched from point to point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve
from scipy.optimize import linear_sum_assignment
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from hbbogie.equilibria.rest import Rest

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
ON_AXIS = 1e-10  # real part, relative to the eigenvalue, up to which it lies on the axis
APART = 1e5  # ratio of successive eigenvalues from which slow ones are computed apart from fast ones
COINCIDENT = 1e7  # condition number of an eigenvalue from which it has no derivative
LOST = 1e-3  # share of its first value up to which an eigenvalue computed again is zero
MANY, FEW = 100, 8  # states beyond which only so many eigenvalues are computed where those near a number count
BESIDE = 1e-4  # relative distance of that number from where they are looked for, which may be an eigenvalue
BATCH = 3e6  # entries of the matrices looked at in one go


def state_matrices(rest: Rest, pencil: Array) -> Array:
    """Return the state matrices, shape (N, n_states, n_states), of stiffness, damping and mass matrices."""
    return _state_matrices(rest, pencil)[0]


def _leading(rest: Rest, pencil: Array) -> tuple[Array, Array]:
    """Return the matrices of the highest derivatives and of the states, shapes (N, n, n) and (N, n, n_states)."""
    K, D, M = pencil
    second = np.array(rest.system.second_order)
    return np.where(second, M, D), np.concatenate([K, D[:, :, second]], axis=2)


def _state_matrices(rest: Rest, pencil: Array) -> tuple[Array, Array, Array]:
    system = rest.system
    E, R = _leading(rest, pencil)
    size = np.abs(E).max(axis=2, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    with np.errstate(all="ignore"):
        try:
            W = np.asarray(-np.linalg.solve(E / size, R / size), dtype=float)
        except np.linalg.LinAlgError:
            W = np.full(R.shape, np.nan)
            for i, (e, r, s) in enumerate(zip(E, R, size, strict=True)):
                if np.isfinite(e).all() and np.linalg.matrix_rank(e / s) == len(e):
                    W[i] = -np.linalg.solve(e / s, r / s)
    return _assembled(system.second_order, W), W, E


def _assembled(second_order: tuple[bool, ...], W: Array, rate: float = 1.0) -> Array:
    """Return matrices of the state from those of the highest derivatives; ``rate`` in the rows dq/dt = v."""
    n, second = W.shape[1], np.flatnonzero(second_order)
    A = np.concatenate([W, W[:, second]], axis=1)
    A[:, second] = 0.0
    A[:, second, n + np.arange(len(second))] = rate
    return A


@dataclass(frozen=True, eq=False)
class Spectra:
    """Eigenvalues and their slopes along the branch at some points.

    Attributes
    ----------
    values : ndarray of complex, shape (N, k), 1/s
        Not a number where the state matrix is not finite. Those that are zero by conservation are left out.
    slopes : ndarray of complex, shape (N, k), 1/s per unit of arclength
    """

    values: Complex
    slopes: Complex


def spectra(rest: Rest, u: Array, t: Array) -> Spectra:
    """Return the eigenvalues at points u with tangents t, shapes (N, m + 1)."""
    N = rest.system.n_states
    size = max(1, int(BATCH / (3 * N * N)))
    parts = [_spectra(rest, u[i : i + size], t[i : i + size]) for i in range(0, len(u), size)]
    return Spectra(*(np.concatenate([part[i] for part in parts]) for i in (0, 1)))


def _spectra(rest: Rest, u: Array, t: Array) -> tuple[Complex, Complex]:
    pencil = rest.pencil(u)
    A, W, E = _state_matrices(rest, pencil)
    with np.errstate(all="ignore"):
        dE, dR = _leading(rest, rest.pencil_slopes(u, t))
        good = np.asarray(np.isfinite(A).all(axis=(1, 2)))
        eye = np.eye(E.shape[1])
        right = dR + dE @ np.where(np.isfinite(W), W, 0.0)
        dW = np.asarray(-np.linalg.solve(np.where(good[:, None, None], E, eye), right), dtype=float)
    dA = _assembled(rest.system.second_order, dW, 0.0)
    dA[~np.isfinite(dA).all(axis=(1, 2))] = 0.0
    A[~good] = 0.0
    values, slopes = _eigen(A, dA)
    for i in np.flatnonzero(good):
        small = _slow(A[i], dA[i], values[i])
        if small is not None:
            order = np.argsort(-np.abs(values[i]), kind="stable")[: len(values[i]) - len(small[0])]
            values[i] = np.append(values[i][order], small[0])
            slopes[i] = np.append(slopes[i][order], small[1])
    values[~good] = np.nan
    if rest.level.zeros:
        order = np.argsort(-np.abs(values), axis=1, kind="stable")[:, : values.shape[1] - rest.level.zeros]
        values, slopes = (np.take_along_axis(x, order, axis=1) for x in (values, slopes))
    return values, slopes


def _eigen(A: Array, dA: Array) -> tuple[Complex, Complex]:
    """Return eigenvalues and their derivatives along dA, not a number where eigenvectors all but coincide."""
    values, V = np.linalg.eig(A)
    with np.errstate(all="ignore"):
        try:
            W = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            W = np.linalg.pinv(V)
        slopes = np.einsum("nij,njk,nki->ni", W, dA, V, optimize=True).astype(complex)
        size = np.abs(V).max(axis=2)  # of each state over all modes: units drop out
        condition = np.linalg.norm(W * size[:, None], axis=2) * np.linalg.norm(V / size[:, :, None], axis=1)
    return values.astype(complex), np.where(np.isfinite(slopes) & (condition < COINCIDENT), slopes, np.nan)


def _slow(A: Array, dA: Array, values: Complex) -> tuple[Complex, Complex] | None:
    """Return the slow eigenvalues of a stiff matrix, from its inverse, which holds them to full accuracy."""
    sizes = np.sort(np.abs(values))
    if not sizes[-1] > APART * sizes[0]:
        return None
    floor = max(sizes[0], 1e-17 * sizes[-1])
    logs = np.log(np.maximum(sizes, floor))
    k = int(np.argmax(np.diff(logs))) + 1
    if not logs[k] - logs[k - 1] > np.log(APART) or sizes[k - 1] == 0:
        return None
    shift = 2 * sizes[k - 1]
    shifted = A - shift * np.eye(len(A))
    rows = np.abs(shifted).max(axis=1)
    try:
        nu, V = np.linalg.eig(np.linalg.solve(shifted / rows[:, None], np.diag(1 / rows)))
    except np.linalg.LinAlgError:  # the slow ones are zeros
        return None
    slow = np.argsort(-np.abs(nu), kind="stable")[:k]
    slopes = np.diag(np.linalg.lstsq(V, dA @ V, rcond=None)[0]) if np.any(dA) else np.zeros(len(A))
    found = shift + 1 / nu[slow].astype(complex)
    found[np.abs(found) < LOST * sizes[k - 1]] = 0.0  # a multiple zero, which round-off had spread
    return found, slopes[slow].astype(complex)


def eigenpairs(A: Array) -> tuple[Complex, Complex]:
    """Return eigenvalues and eigenvectors of one state matrix, slow ones accurate also beside fast ones."""
    values, V = (x.astype(complex) for x in np.linalg.eig(A))
    slow = _slow(A, np.zeros_like(A), values)
    if slow is not None:
        order = np.argsort(np.abs(values), kind="stable")[: len(slow[0])]
        values[order[matched(values[order], slow[0])]] = slow[0]
    return values, V


def eigenpairs_near(A: Array, value: complex) -> tuple[Complex, Complex]:
    """Return the eigenvalues nearest to a number, at least one more than lie together there, and their vectors.

    Of a small matrix all are given; of a large one these take a tenth of the time, by Arnoldi's method with the
    inverse.
    """
    n = len(A)
    if n <= MANY:
        return eigenpairs(A)
    shift = value + BESIDE * abs(value)
    factors = lu_factor(A - shift * np.eye(n))
    inverse = LinearOperator((n, n), matvec=lambda x: lu_solve(factors, x), dtype=complex)
    try:
        nu, V = eigs(inverse, k=FEW, v0=np.ones(n, dtype=complex), tol=0)
    except ArpackNoConvergence:
        return eigenpairs(A)
    values = np.asarray(shift + 1 / nu, dtype=complex)
    return (values, np.asarray(V)) if np.ptp(np.abs(values - value)) > BESIDE * abs(value) else eigenpairs(A)


def matched(a: Complex, b: Complex) -> NDArray[np.intp]:
    """Return for each of ``b`` the place of its partner in ``a``: the least sum of relative distances."""
    size = np.abs(a)[:, None] + np.abs(b)
    cost = np.abs(a[:, None] - b) / np.where(size > 0, size, 1.0)
    rows, columns = linear_sum_assignment(cost)
    return rows[np.argsort(columns)]


@dataclass(frozen=True, eq=False)
class Pairing:
    """Eigenvalues over S steps, each matched to its partner: cubic in between.

    Attributes
    ----------
    start, end : ndarray of complex, shape (S, k), 1/s
    rise, fall : ndarray of complex, shape (S, k), 1/s
        Slopes at start and end, times the length of the step.
    """

    start: Complex
    end: Complex
    rise: Complex
    fall: Complex

    @staticmethod
    def of(a: Complex, b: Complex, da: Complex, db: Complex, h: Array) -> Pairing:
        """Match the eigenvalues at both ends of steps of length h, shape (S,), by where slopes lead in the middle."""
        h = h[:, None]
        ahead, back = (_limited(x, np.where(np.isnan(d), 0.0, d) * h / 2) for x, d in ((a, da), (b, -db)))
        order = np.array([np.argsort(matched(x, y)) for x, y in zip(ahead, back, strict=True)])
        b, rise, fall = np.take_along_axis(b, order, axis=1), da * h, np.take_along_axis(db, order, axis=1) * h
        return Pairing(a, b, np.where(np.isnan(rise), b - a, rise), np.where(np.isnan(fall), b - a, fall))

    def __getitem__(self, step: int) -> Pairing:
        """Return that of one step alone, without the first dimension."""
        return Pairing(self.start[step], self.end[step], self.rise[step], self.fall[step])

    @property
    def size(self) -> Array:
        """Larger modulus of each eigenvalue at the two ends, shape (S, k) [1/s]."""
        return np.maximum(np.abs(self.start), np.abs(self.end))

    @property
    def error(self) -> Array:
        """How much real parts and their slopes at both ends disagree, shape (S, k) [1/s]."""
        return np.asarray(np.abs((self.end - self.start - (self.rise + self.fall) / 2).real))

    def real(self, x: Array) -> Array:
        """Return the real parts at shares x of the step, of shape (m,) or (S, k, m); shape (S, k, m)."""
        a, _, da, _ = self._ends
        second, third = self._bends
        return np.asarray(a + x * (da + x * (second + x * third)))

    def extremes(self) -> Array:
        """Return the real parts where they turn inside the step, at an end where they do not, shape (S, k, 2)."""
        da, (second, third) = self._ends[2], self._bends
        with np.errstate(all="ignore"):
            q = -second - np.where(second >= 0, 1.0, -1.0) * np.sqrt(second**2 - 3 * third * da)
            x = np.concatenate([q / (3 * third), da / q], axis=-1)
        return self.real(np.where((x > 0) & (x < 1), x, 0.0))

    @property
    def _ends(self) -> tuple[Array, Array, Array, Array]:
        a, b, da, db = (z.real[..., None] for z in (self.start, self.end, self.rise, self.fall))
        return a, b, da, db

    @property
    def _bends(self) -> tuple[Array, Array]:
        a, b, da, db = self._ends
        return 3 * (b - a) - 2 * da - db, 2 * (a - b) + da + db


def _limited(values: Complex, steps: NDArray[Any]) -> Complex:
    """Return values moved by steps, none farther than its own size: where eigenvectors coincide slopes are infinite."""
    size = np.abs(steps)
    share = np.minimum(1.0, np.abs(values) / np.where(size > 0, size, 1.0))
    return np.asarray(values + np.where(size > 0, share, 0.0) * steps)
