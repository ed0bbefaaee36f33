"""What a curve of solutions has to provide so that `walk` can follow it: its equations, linearised at a point.

If the derivative is a full matrix, `Dense` does the rest, and `Sparse` if it is a sparse one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from hbbogie.brief import brief
from hbbogie.results.ending import Ending
from hbbogie.solving.linear import Factors, with_row

Array = NDArray[np.float64]


class Linearised(Protocol):
    """The equations of a curve at a point with their derivative J, shape (n, n + 1), in scaled unknowns."""

    @property
    def residual(self) -> Array:
        """Residual of each equation, scaled, shape (n,)."""

    def solve(self, plane: Array, right: Array) -> tuple[Array, float]:
        """Solve the equations bordered by one more row.

        Parameters
        ----------
        plane : ndarray, shape (n + 1,)
        right : ndarray, shape (n + 1,)

        Returns
        -------
        x : ndarray, shape (n + 1,)
            With J x = right[:-1] and plane . x = right[-1].
        sign : float
            Of det [J; plane]; 0 where it is not known.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the matrix is singular.
        """


@dataclass(frozen=True, eq=False)
class Dense:
    """Linearised equations whose derivative is a full matrix.

    Attributes
    ----------
    residual : ndarray, shape (n,)
    jacobian : ndarray, shape (n, n + 1)
        Both scaled.
    """

    residual: Array
    jacobian: Array

    __repr__ = brief

    def solve(self, plane: Array, right: Array) -> tuple[Array, float]:
        """Solve the bordered equations by LU factorisation, see `Linearised`."""
        n = len(plane)
        bordered = np.empty((n, n), order="F")
        bordered[:-1], bordered[-1] = self.jacobian, plane
        lu, pivots, x, singular = dgesv(bordered, right, overwrite_a=True)
        if singular:
            raise np.linalg.LinAlgError("the bordered Jacobian is singular")
        flips = np.count_nonzero(pivots != np.arange(n)) + np.count_nonzero(lu.diagonal() < 0)
        return x, -1.0 if flips % 2 else 1.0

    def across(self) -> Array:
        """Return a vector that is normal to no tangent: here the tangent itself."""
        return np.asarray(np.linalg.svd(self.jacobian)[2][-1])

    def signed_size(self, plane: Array) -> float:
        """Return the smallest singular value of the bordered equations, with the sign of the determinant."""
        bordered = np.vstack([self.jacobian, plane])
        sign = np.linalg.slogdet(bordered)[0]
        return float(sign * np.linalg.svd(bordered, compute_uv=False)[-1])


@dataclass(frozen=True, eq=False)
class Sparse:
    """Linearised equations whose derivative is a sparse matrix.

    Attributes
    ----------
    residual : ndarray, shape (n,)
    jacobian : scipy.sparse.csc_matrix, shape (n, n + 1)
        Both scaled.
    """

    residual: Array
    jacobian: Any

    __repr__ = brief

    def solve(self, plane: Array, right: Array) -> tuple[Array, float]:
        """Solve the bordered equations by sparse LU factorisation, see `Linearised`."""
        factors = Factors(with_row(self.jacobian, plane))
        return factors.solve(right), factors.sign

    def across(self) -> Array:
        """Return a vector that is normal to no tangent: a random one."""
        return np.random.default_rng(0).standard_normal(self.jacobian.shape[1])

    def signed_size(self, plane: Array) -> float:
        """Return the smallest singular value of the bordered equations, with the sign of the determinant."""
        try:
            factors = Factors(with_row(self.jacobian, plane))
        except np.linalg.LinAlgError:
            return 0.0
        return factors.sign * factors.smallest


class Curve(Protocol):
    """A curve of solutions. Implement these attributes and methods, and `walk` can follow it.

    Attributes
    ----------
    scale : ndarray, shape (n + 1,)
        Typical size of each unknown.
    weights : ndarray, shape (n + 1,)
        Weights of the inner product: 1 for unknowns that count in the distance, 0 for those that follow from them.
    window : dict of int to (float, float)
        Limits of some of the unknowns, by their place, at which the walk ends.
    tolerance : float
        Largest scaled residual of a point.
    """

    scale: Array
    weights: Array
    window: dict[int, tuple[float, float]]
    tolerance: float

    def linearise(self, u: Array) -> Linearised:
        """Return the equations and their derivative at the unknowns."""

    def settle(self, u: Array) -> None:
        """Take note of a new point of the curve, for example to update a normalisation."""

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why a curve with these points ends before the next one, or None."""

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of an unknown."""

    def where(self, u: Array) -> str:
        """Return a description of a place on the curve for messages, such as ``V = 90``."""


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a curve.

    Attributes
    ----------
    u : ndarray, shape (n + 1,)
        Unknowns.
    tangent : ndarray, shape (n + 1,)
        Unit vector along the curve, in scaled unknowns.
    residual : ndarray, shape (n,)
        Scaled.
    orientation : float
        Sign of det [J; tangent], which changes at branch points only; 0 where it is not known.
    """

    u: Array
    tangent: Array
    residual: Array
    orientation: float = 0.0

    __repr__ = brief

    @property
    def error(self) -> float:
        """Largest scaled residual."""
        return float(np.abs(self.residual).max())

    def turned(self) -> Point:
        """Return the point with the tangent reversed."""
        return replace(self, tangent=-self.tangent, orientation=-self.orientation)
