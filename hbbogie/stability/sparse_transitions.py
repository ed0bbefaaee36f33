"""Transition matrices of many states: Runge-Kutta steps with a sparse state matrix, in groups of intervals."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, eigs

from hbbogie.methods.size import has_many_states
from hbbogie.model.system import System
from hbbogie.solving.newton import Buffered
from hbbogie.stability.variation import Waveforms

Array = NDArray[np.float64]
COLUMNS = 68  # of a transition matrix that are stepped together
GROUP = 32  # intervals of a group: few enough for an accurate determinant of its transition matrix


def in_groups(system: System) -> bool:
    """Tell whether transition matrices are those of groups of intervals; where elements jump they are not."""
    return has_many_states(system) and all(element.heights is None for element in system.elements)


class SparseMatrices:
    """The state matrix along one of several orbits, as sparse matrices."""

    def __init__(self, waveforms: Waveforms, of: int):
        system, matrix = waveforms.system, waveforms.model.matrix
        self.system, self.p, self.n = system, waveforms.p[of], system.n_states
        self.entries = system.once("entries of the state matrix", lambda: _entries(matrix))
        columns = matrix.sparsity_out(0).T  # its columns are the rows
        self.pattern = np.array(columns.row()), np.array(columns.colind())
        row = np.repeat(np.arange(self.n), np.diff(self.pattern[1]))
        self.diagonal = np.flatnonzero(row == self.pattern[0])

    def values(self, x: Array, lines: Array) -> Array:
        """Return the entries at varying states, shape (M, m), and lines, shape (M, entries)."""
        M = len(lines)
        run = self.system.once(("entries of state matrices", M), lambda: Buffered(self.entries.map(M)))
        return np.asarray(run(x.ravel(), lines.ravel(), np.tile(self.p, M))[0].T)

    def matrix(self, values: Array) -> csr_matrix:
        """Return the state matrix with these entries."""
        return csr_matrix((values, *self.pattern), shape=(self.n, self.n))


def _entries(matrix: ca.Function) -> ca.Function:
    """Return the entries of a sparse matrix that a function gives, row by row, as a vector."""
    arguments = [ca.SX.sym(matrix.name_in(i), *matrix.size_in(i)) for i in range(matrix.n_in())]
    return ca.Function("entries", arguments, [ca.densify(matrix(*arguments).T.nz[:])])


def spectral_radius(waveforms: Waveforms, x: Array, lines: Array, of: int) -> float:
    """Return the largest modulus of the state matrix's eigenvalues at varying states and lines of an orbit [1/s]."""
    sparse = SparseMatrices(waveforms, of)
    return max(radius(sparse.matrix(values)) for values in sparse.values(x, lines))


def radius(matrix: csr_matrix) -> float:
    """Return the largest modulus of the eigenvalues of a sparse matrix, right to a hundredth."""
    try:
        found = eigs(matrix, k=1, which="LM", v0=np.ones(matrix.shape[0]), tol=1e-2, return_eigenvectors=False)
    except ArpackNoConvergence:
        found = np.linalg.eigvals(matrix.toarray())
    return float(np.abs(found).max())


def group_matrices(waveforms: Waveforms, mesh: Array, of: int) -> tuple[Array, float]:
    """Return the transition matrices of groups of intervals, and the integral of the trace by Simpson's rule.

    Parameters
    ----------
    waveforms : Waveforms
    mesh : ndarray, shape (N + 1,), rad
    of : int
        The place of the orbit.
    """
    sparse, steps, found, trace = SparseMatrices(waveforms, of), np.diff(mesh) / waveforms.omega[of], [], 0.0
    for first in range(0, len(steps), GROUP):
        part, h = mesh[first : first + GROUP + 1], steps[first : first + GROUP]
        middle = 0.5 * (part[:-1] + part[1:])
        lines = waveforms.lines(middle, of)
        start, half, end = (sparse.values(waveforms.states(tau, of), lines) for tau in (part[:-1], middle, part[1:]))
        traces = (start + 4 * half + end)[:, sparse.diagonal].sum(axis=1) / 6
        trace += float(h @ traces)
        matrix, rows = sparse.matrix(start[0]), list(zip(start, half, end, strict=True))
        blocks = [  # a few columns at a time stay in the cache
            _stepped(h, matrix, rows, np.eye(sparse.n)[:, c : c + COLUMNS]) for c in range(0, sparse.n, COLUMNS)
        ]
        found.append(np.hstack(blocks))
    return np.array(found), trace


def _stepped(steps: Array, A: csr_matrix, entries: Sequence[tuple[Array, ...]], Phi: Array) -> Array:
    """Return a matrix after fourth-order Runge-Kutta steps of Phi' = A(t) Phi, given A's entries at three times."""
    for h, (start, half, end) in zip(steps, entries, strict=True):
        A.data = start  # a new matrix would take as long as its product
        k1 = A @ Phi
        A.data = half
        k2 = A @ (Phi + 0.5 * h * k1)
        k3 = A @ (Phi + 0.5 * h * k2)
        A.data = end
        k1 += A @ (Phi + h * k3)
        k2 += k3
        Phi = Phi + h / 6 * k1 + h / 3 * k2
    return Phi
