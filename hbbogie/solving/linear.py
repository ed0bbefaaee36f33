"""Matrices of linearised equations, full or sparse: scaling, solution, smallest singular value."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import norm, splu

Array = NDArray[np.float64]
Matrix = Any  # ndarray or scipy.sparse.csc_matrix
TURNS = 8  # of inverse iteration, which gains the square of the ratio of the two smallest values in each


def scaled(matrix: Matrix, rows: Array, columns: Array) -> Matrix:
    """Return a matrix with its rows divided and its columns multiplied by their scales."""
    if not sparse.issparse(matrix):
        return matrix / rows[:, None] * columns
    found = matrix.tocsc(copy=True)
    found.data *= np.repeat(columns, np.diff(found.indptr)) / rows[found.indices]
    return found


def with_row(matrix: Matrix, row: Array) -> Matrix:
    """Return a matrix with one more row, the last."""
    if not sparse.issparse(matrix):
        return np.vstack([matrix, row])
    return sparse.vstack([matrix, sparse.csc_matrix(np.atleast_2d(row))], format="csc")


class Factors:
    """The triangular factors of a sparse square matrix.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular to the last digit, or not finite.
    """

    def __init__(self, matrix: Matrix):
        if not np.isfinite(matrix.data).all():
            raise np.linalg.LinAlgError("the matrix is not finite")
        try:
            self.lu = splu(matrix)
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None

    def solve(self, right: Array, trans: Literal["N", "T"] = "N") -> Array:
        """Return the solution for a right-hand side, with "T" of the transposed matrix."""
        return np.asarray(self.lu.solve(right, trans=trans))

    @property
    def sign(self) -> float:
        """Sign of the determinant."""
        return _parity(self.lu.perm_r) * _parity(self.lu.perm_c) * float(np.prod(np.sign(self.lu.U.diagonal())))

    @property
    def smallest(self) -> float:
        """Smallest singular value, by inverse iteration."""
        y = np.random.default_rng(0).standard_normal(self.lu.shape[0])
        for _ in range(TURNS):
            y = self.lu.solve(self.lu.solve(y / np.linalg.norm(y)), trans="T")
        return float(np.linalg.norm(y) ** -0.5) if np.isfinite(y).all() else 0.0


def solution(matrix: Matrix, right: Array) -> Array:
    """Return the solution of square linear equations; raise `numpy.linalg.LinAlgError` if they are singular."""
    return Factors(matrix).solve(right) if sparse.issparse(matrix) else np.asarray(np.linalg.solve(matrix, right))


def singularity(matrix: Matrix) -> float:
    """Return the smallest singular value of a square matrix relative to the largest, or to a bound of it."""
    if not sparse.issparse(matrix):
        sizes = np.linalg.svd(matrix, compute_uv=False)
        return float(sizes[-1] / sizes[0])
    try:
        return Factors(matrix).smallest / float(norm(matrix, 1) * norm(matrix, np.inf)) ** 0.5
    except np.linalg.LinAlgError:
        return 0.0


def _parity(order: NDArray[np.int_]) -> float:
    """Return +1 for an even permutation, -1 for an odd one."""
    left, cycles = np.ones(len(order), dtype=bool), 0
    for i in range(len(order)):
        cycles += left[i]
        while left[i]:
            left[i] = False
            i = order[i]
    return -1.0 if (len(order) - cycles) % 2 else 1.0
