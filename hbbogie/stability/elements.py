"""The field along shooting's elements, and their stages eliminated, by sparse matrices where there are many states."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from hbbogie.model.dynamics import state_of
from hbbogie.model.system import System
from hbbogie.stability.variation import on_lines

Array = NDArray[np.float64]
Field = tuple[ca.Function, ca.Function, tuple[list[int], list[int]]]


def field_of(system: System) -> Field:
    """Return functions of (x, lines, p): dx/dt and the contacts' arguments u, each with its derivative in x.

    Of the derivative of dx/dt only the entries that may differ from zero; last their rows and columns.
    """
    return system.once("shooting", lambda: _field(system))


def _field(system: System) -> Field:
    q, v, lines, p, velocity, rates, contacts = on_lines(system)
    x = state_of(system.dynamics, q, v)
    u = ca.vertcat(*(e.argument(q, velocity, p) for e in contacts)) if contacts else ca.SX(0, 1)
    J, du = ca.jacobian(rates, x), ca.densify(ca.jacobian(u, x))
    field = ca.Function("rates", [x, lines, p], [rates, ca.densify(J.nz[:])])
    arguments = ca.Function("arguments", [x, lines, p], [ca.densify(u), du])
    return field, arguments, (J.sparsity().row(), J.sparsity().get_col())


def responses(h: Array, integrate: Array, J: Array, right: Array, sparse: bool) -> Array:
    """Return the solutions of (1 - h integrate J) y = right on each element, shape (N, stages, n, columns).

    Parameters
    ----------
    h : ndarray, shape (N,), s
        Durations of the elements.
    integrate : ndarray, shape (stages, stages)
        Integrals over the element's share up to each stage.
    J : ndarray, shape (N, stages, n, n), 1/s
        Derivatives of the rates at the stages.
    right : ndarray, shape (N, stages, n, columns)
    sparse : bool
        Whether most entries of J are zero, the same ones in all.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where a matrix is singular.
    """
    if sparse:
        return _sparse(h, integrate, J, right)
    N, stages, n, columns = right.shape
    simple, of, factor = _integrals_of_others(J)
    rest = np.setdiff1d(np.arange(n), simple)
    m, sums = len(rest), h[:, None, None] * integrate
    by_rest, by_simple = (J[:, :, rest[:, None], states] for states in (rest, simple))
    blocks = np.empty((N, stages, m, stages, m))
    np.multiply(-sums[:, :, None, :, None], by_rest.transpose(0, 2, 1, 3)[:, None], out=blocks)
    twice = (integrate[:, None] * integrate.T).reshape(-1, stages) @ (by_simple * factor).reshape(N, stages, -1)
    twice = twice.reshape(N, stages, stages, m, -1).transpose(0, 1, 3, 2, 4)
    blocks[..., np.searchsorted(rest, of)] -= (h**2)[:, None, None, None, None] * twice
    M = blocks.reshape(N, stages * m, stages * m)
    M[:, np.arange(stages * m), np.arange(stages * m)] += 1
    known = sums @ (by_simple @ right[:, :, simple]).reshape(N, stages, -1)
    known = right[:, :, rest] + known.reshape(N, stages, m, columns)
    found = np.empty(right.shape)
    found[:, :, rest] = np.linalg.solve(M, known.reshape(N, stages * m, -1)).reshape(known.shape)
    integrals = (sums @ found[:, :, of].reshape(N, stages, -1)).reshape(N, stages, len(of), columns)
    found[:, :, simple] = right[:, :, simple] + factor[:, None] * integrals
    return found


def _integrals_of_others(J: Array) -> tuple[NDArray[np.int_], NDArray[np.int_], Array]:
    """Return states whose rates are another state times a constant, as positions are, the others, and the constants.

    None of the others is among them, and none is there twice.
    """
    entries = (J != 0).any(axis=(0, 1))
    of, state = entries.argmax(axis=1), np.arange(len(entries))
    rates = J[:, :, state, of]
    alone = (entries.sum(axis=1) == 1) & (of != state) & (rates == rates[0, 0]).all(axis=(0, 1))
    simple = np.flatnonzero(alone & ~alone[of])
    simple = simple[np.unique(of[simple], return_index=True)[1]]
    return simple, of[simple], rates[0, 0, simple]


def _sparse(h: Array, integrate: Array, J: Array, right: Array) -> Array:
    N, stages, n, columns = right.shape
    i, j = np.nonzero((J != 0).any(axis=(0, 1)) | np.eye(n, dtype=bool))
    stage = np.arange(stages)
    row = np.broadcast_to(i[:, None, None] * stages + stage[:, None], (len(i), stages, stages)).ravel()
    column = np.broadcast_to(j[:, None, None] * stages + stage, (len(i), stages, stages)).ravel()
    one = ((i == j)[:, None, None] * np.eye(stages)).ravel()
    order = np.lexsort((row, column))  # by columns: the stages of a state lie together, which keeps the factors sparse
    pattern = row[order], np.searchsorted(column[order], np.arange(n * stages + 1))
    found = np.empty(right.shape)
    for k in range(N):
        entries = one - (h[k] * integrate * J[k][:, i, j].T[:, None, :]).ravel()
        try:
            factors = splu(csc_matrix((entries[order], *pattern)))
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None
        solved = factors.solve(right[k].swapaxes(0, 1).reshape(n * stages, columns))
        found[k] = solved.reshape(n, stages, columns).swapaxes(0, 1)
    return found
