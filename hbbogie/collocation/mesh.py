"""Meshes over a period: equidistribution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.polynomials import gauss

Array = NDArray[np.float64]
ROUND_OFF = 2.2e-16  # of scaled values
FLOOR = 0.1  # share of its mean below which the density of a mesh does not fall


def equidistributed(mesh: Array, values: Array, N: int, kinks: NDArray[np.bool_] | None = None) -> Array:
    """Return the mesh of N intervals on which a piecewise polynomial of degree m has equal errors.

    Equal are the integrals of the (m + 1)-th root of the derivative of order m + 1, which is taken from the jumps of
    that of order m (R. D. Russell, J. Christiansen, SIAM J. Numer. Anal. 15 (1978) 59-80).

    Parameters
    ----------
    mesh : ndarray, shape (M + 1,)
    values : ndarray, shape (M, m + 1, n)
        Scaled, at the beginnings of the intervals and their Gauss points.
    N : int
    kinks : ndarray of bool, shape (M,), optional
        Whether the motion itself has a kink where an interval begins, which is no error.
    """
    h, m = np.diff(mesh), values.shape[1] - 1
    leading = gauss(m).leading
    top = np.einsum("k,ikn->in", leading, values) / h[:, None] ** m
    jumps = np.abs(top - np.roll(top, 1, axis=0))
    known = np.ones(len(h)) if kinks is None else 1.0 - kinks
    # contacts leave tiny intervals, in which the derivative is round-off
    noise = (0.0 if kinks is None else ROUND_OFF) * np.abs(leading).sum() / h[:, None] ** m
    jumps = np.maximum(jumps - noise - np.roll(noise, 1, axis=0), 0.0)
    jumps = jumps / (0.5 * (h + np.roll(h, 1)))[:, None]
    sides = known + np.roll(known, -1)  # of each interval at which the jump tells the error
    both = known[:, None] * jumps + np.roll(known[:, None] * jumps, -1, axis=0)
    size = (both / np.maximum(sides, 1.0)[:, None]).max(axis=1)
    size = np.where(sides > 0, size, (np.maximum(np.abs(top) - noise, 0.0) / h[:, None]).max(axis=1))
    return spread(mesh, size ** (1 / (m + 1)), N)


def spread(mesh: Array, density: Array, N: int) -> Array:
    """Return the mesh of N intervals with equal integrals of a density given on the intervals of another mesh."""
    h = np.diff(mesh)
    mean = float(density @ h)
    density = np.maximum(density / mean, FLOOR) if mean > 0 else np.ones_like(h)
    integral = np.append(0.0, np.cumsum(density * h))
    return np.interp(np.linspace(0, integral[-1], N + 1), integral, mesh)
