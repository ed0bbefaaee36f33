"""Piecewise polynomials on a mesh, by their values where intervals begin and at the Gauss points of each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from hbbogie.brief import brief

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gauss:
    """Gauss collocation of one degree on an interval from 0 to 1.

    Attributes
    ----------
    c, b : ndarray, shape (m,)
        Points and weights.
    a : ndarray, shape (m, m)
        Integrals of the cardinal functions from 0 to each point.
    d : ndarray, shape (m,)
        Weights of the stages in the state at the end, b a^-1; that at the beginning has the weight 1 - sum d.
    to_legendre : ndarray, shape (m + 1, m + 1)
        Values at 0 and at the points to Legendre coefficients.
    leading : ndarray, shape (m + 1,)
        Values at 0 and at the points to the derivative of order m.
    """

    c: Array
    b: Array
    a: Array
    d: Array
    to_legendre: Array
    leading: Array

    __repr__ = brief

    @property
    def m(self) -> int:
        """Degree, and number of points."""
        return len(self.c)

    @property
    def begin(self) -> float:
        """Weight of the state at the beginning in that at the end."""
        return float(1 - self.d.sum())

    def basis(self, theta: Array, derivative: int = 0) -> Array:
        """Return the matrix from values at 0 and at the points to those at theta, shape (len(theta), m + 1)."""
        coefficients = np.asarray(2.0**derivative * legendre.legder(self.to_legendre, derivative), dtype=float)
        return np.asarray(legendre.legvander(2 * np.asarray(theta) - 1, len(coefficients) - 1) @ coefficients)


@lru_cache
def gauss(m: int) -> Gauss:
    """Return Gauss collocation of degree m."""
    x, w = legendre.leggauss(m)
    c, b = (x + 1) / 2, w / 2
    P, k = legendre.legvander(x, m), np.arange(1, m)
    integrals = np.column_stack([x + 1, (P[:, 2:] - P[:, :-2]) / (2 * k + 1)])
    a = integrals @ np.linalg.inv(P[:, :m]) / 2
    points = np.append(0.0, c)
    distances = points[:, None] - points + np.eye(m + 1)
    leading = float(np.prod(np.arange(1, m + 1))) / np.prod(distances, axis=1)
    return Gauss(c, b, a, np.linalg.solve(a.T, b), np.linalg.inv(legendre.legvander(2 * points - 1, m)), leading)


def points_of(mesh: Array, m: int) -> Array:
    """Return the beginnings of the intervals and their Gauss points, shape (N, m + 1)."""
    return np.asarray(mesh[:-1, None] + np.diff(mesh)[:, None] * np.append(0.0, gauss(m).c))


def moved(mesh: Array, values: Array, onto: Array, m: int) -> Array:
    """Return a piecewise polynomial at the beginnings and Gauss points of another mesh or degree, shape (N, m + 1, n).

    Parameters
    ----------
    mesh : ndarray, shape (M + 1,)
    values : ndarray, shape (M, degree + 1, n)
        At the beginnings of the intervals and their Gauss points.
    onto : ndarray, shape (N + 1,)
    m : int
        Number of Gauss points there.
    """
    return _raised(values.shape[1] - 1, m) @ values if onto is mesh else evaluated(mesh, values, points_of(onto, m))


@lru_cache
def slopes_of(m: int) -> Array:
    """Return the matrix from values at 0 and at the Gauss points of an interval to the derivatives there."""
    return gauss(m).basis(np.append(0.0, gauss(m).c), 1)


@lru_cache
def within(m: int, parts: int) -> Array:
    """Return the matrix from values at 0 and at the Gauss points to those where equal parts of an interval begin."""
    return gauss(m).basis(np.arange(parts) / parts)


@lru_cache
def _raised(degree: int, m: int) -> Array:
    """Return the matrix from values at the points of one degree to those of another on the same interval."""
    return gauss(degree).basis(np.append(0.0, gauss(m).c))


def evaluated(mesh: Array, values: Array, s: Array, derivative: int = 0) -> Array:
    """Return a piecewise polynomial, or its derivative, at shares s of the period.

    Parameters
    ----------
    mesh : ndarray, shape (N + 1,)
        From 0 to 1.
    values : ndarray, shape (N, m + 1, n)
        At the beginnings of the intervals and their Gauss points.
    s : ndarray
        From 0 to 1.
    derivative : int

    Returns
    -------
    ndarray, shape of s with n more at its end
    """
    flat, h = np.ravel(s), np.diff(mesh)
    i = np.clip(np.searchsorted(mesh, flat, side="right") - 1, 0, len(h) - 1)
    basis = gauss(values.shape[1] - 1).basis((flat - mesh[i]) / h[i], derivative) / h[i, None] ** derivative
    return np.asarray(np.einsum("km,kmn->kn", basis, values[i])).reshape(*np.shape(s), values.shape[-1])
