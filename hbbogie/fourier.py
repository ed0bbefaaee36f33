"""The harmonic basis: coefficient layout, synthesis, analysis, derivative, resampling.

A real signal with period 2 pi in the phase tau is kept as an array of coefficients ``c``
of shape (2 H + 1, n): row 0 is the mean, row 2 h - 1 the cosine and row 2 h the sine
coefficient of harmonic h::

    x(tau) = c[0] + sum_h c[2 h - 1] cos(h tau) + c[2 h] sin(h tau)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rows_of(harmonics: Sequence[int]) -> NDArray[np.int_]:
    """Return the coefficient rows of the given harmonics, in increasing order of harmonic."""
    return np.array([r for h in harmonics for r in ((0,) if h == 0 else (2 * h - 1, 2 * h))], dtype=int)


def highest(coefficients: ArrayLike) -> int:
    """Return the highest harmonic H of an array of shape (2 H + 1, ...)."""
    return (np.shape(coefficients)[0] - 1) // 2


def phases(samples: int) -> Array:
    """Return ``samples`` equidistant phases tau_k = 2 pi k / N [rad], shape (N,)."""
    return 2 * np.pi * np.arange(samples) / samples


def synthesis(H: int, tau: ArrayLike, derivative: int = 0) -> Array:
    """Return the matrix that maps coefficients to values at the phases ``tau``.

    Parameters
    ----------
    H : int
        Highest harmonic.
    tau : array_like, shape (N,), rad
        Phases.
    derivative : int
        Order of the derivative with respect to tau.

    Returns
    -------
    ndarray, shape (N, 2 H + 1)
    """
    tau = np.atleast_1d(np.asarray(tau, dtype=float))
    h = np.arange(1, H + 1)
    angle, E = tau[:, None] * h, np.empty((tau.size, 2 * H + 1))
    E[:, 0] = 1.0 if derivative == 0 else 0.0
    # the derivative of order m of cos(h tau) is h^m cos(h tau + m pi/2); quarter turns are exact this way
    first, second = (np.sin, np.cos) if derivative % 2 else (np.cos, np.sin)
    first(angle, out=E[:, 1::2])
    second(angle, out=E[:, 2::2])
    if derivative:
        E[:, 1::2] *= h**derivative * (-1 if derivative % 4 in (1, 2) else 1)
        E[:, 2::2] *= h**derivative * (-1 if derivative % 4 in (2, 3) else 1)
    return E


def analysis(H: int, samples: int) -> Array:
    """Return the matrix, shape (2 H + 1, N), that maps N equidistant samples to coefficients.

    Exact (the left inverse of `synthesis`) when N > 2 H.
    """
    A = synthesis(H, phases(samples)).T * (2.0 / samples)
    A[0] *= 0.5
    return A


def derivative(coefficients: ArrayLike, order: int = 1) -> Array:
    """Return the coefficients of the derivative of the given order with respect to tau."""
    c = np.array(coefficients, dtype=float)
    h = np.arange(1, highest(c) + 1).reshape((-1,) + (1,) * (c.ndim - 1))
    for _ in range(order):
        d = np.zeros_like(c)
        d[1::2] = h * c[2::2]
        d[2::2] = -h * c[1::2]
        c = d
    return c


def resize(coefficients: ArrayLike, H: int) -> Array:
    """Return the coefficients cut off, or filled with zeros, to the highest harmonic H."""
    c = np.asarray(coefficients, dtype=float)
    out = np.zeros((2 * H + 1, *c.shape[1:]))
    m = min(len(c), len(out))
    out[:m] = c[:m]
    return out


def shift(coefficients: ArrayLike, tau: float) -> Array:
    """Return the coefficients of x(t + tau), ``tau`` in rad: the time origin moved by tau."""
    c = np.array(coefficients, dtype=float)
    angle = (np.arange(1, highest(c) + 1) * tau).reshape((-1,) + (1,) * (c.ndim - 1))
    a, b = c[1::2].copy(), c[2::2].copy()
    c[1::2] = a * np.cos(angle) + b * np.sin(angle)
    c[2::2] = b * np.cos(angle) - a * np.sin(angle)
    return c


def is_odd(coefficients: ArrayLike, tolerance: float = 1e-9) -> bool:
    """Tell whether x(tau + pi) = -x(tau): no mean and no even harmonics, relative to the largest coefficient."""
    c = np.abs(np.asarray(coefficients, dtype=float))
    even = [0, *(r for h in range(2, highest(c) + 1, 2) for r in (2 * h - 1, 2 * h))]
    return bool(c[even].max(initial=0.0) <= tolerance * c.max(initial=0.0))


def extremes(coefficients: ArrayLike) -> tuple[Array, Array]:
    """Return the smallest and largest value of each signal over the period.

    Sampled on a grid of at least 16 points per highest harmonic, then refined by one Newton step on
    the derivative from the best sample, which is good to round-off for a resolved signal.

    Parameters
    ----------
    coefficients : array_like, shape (2 H + 1, n)

    Returns
    -------
    smallest, largest : ndarray, shape (n,)
    """
    c = np.asarray(coefficients, dtype=float)
    grid, E = _fine(highest(c))
    x = E @ c
    column = np.arange(c.shape[1])
    best = np.concatenate([x.argmin(axis=0), x.argmax(axis=0)])
    tau, sampled, twice = grid[best], x[best, np.tile(column, 2)], np.hstack([c, c])
    rate = derivative(twice)
    bend = derivative(rate)
    for _ in range(3):
        E = synthesis(highest(c), tau)
        d1, d2 = np.einsum("ij,ji->i", E, rate), np.einsum("ij,ji->i", E, bend)
        step = np.divide(-d1, d2, out=np.zeros_like(d1), where=np.abs(d2) > 0)
        tau = tau + np.clip(step, -grid[1], grid[1])
    refined = np.einsum("ij,ji->i", synthesis(highest(c), tau), twice)
    smallest, largest = np.split(np.arange(len(tau)), 2)
    return np.minimum(refined, sampled)[smallest], np.maximum(refined, sampled)[largest]


@lru_cache(maxsize=16)
def _fine(H: int) -> tuple[Array, Array]:
    """Return phases, at least 16 for each wave of the highest harmonic, rad, and the matrix of synthesis there."""
    grid = phases(max(256, 32 * H))
    return grid, synthesis(H, grid)
