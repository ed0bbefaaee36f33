"""Linear functions of positions and velocities along an orbit, in whichever form its motion is stored."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.results import Orbit
from hbbogie.results.periodic import FourierSeries

Array = NDArray[np.float64]


class Signals(Protocol):
    """M functions of the phase."""

    def at(self, tau: Array, derivative: int = 0) -> Array:
        """Return the functions, or a derivative of theirs in tau, at phases tau [rad], shape (len(tau), M)."""

    def with_slope(self, tau: Array, column: NDArray[np.int_], derivative: int) -> tuple[Array, Array]:
        """Return one function, or a derivative of it, at each of some phases, and the next derivative there."""

    def on_grid(self, H: int, end: float) -> tuple[Array, Array, Array]:
        """Return phases from 0 to end, fine enough for harmonic H, and the functions and their derivatives there."""

    @property
    def size(self) -> Array:
        """Bound on the absolute value of each, shape (M,), close to the largest."""

    @property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each, each of shape (M,)."""


def signals(orbit: Orbit, dq: Array, dv: Array, rest: Array) -> Signals:
    """Return the functions dq q + dv v + rest along an orbit.

    Parameters
    ----------
    orbit : Orbit
    dq, dv : ndarray, shape (M, n)
    rest : ndarray, shape (M,)
    """
    if orbit.advance or not isinstance(orbit.motion, FourierSeries):
        return _OfMotion(orbit, dq, dv, rest)
    c = orbit.coefficients
    functions = c @ dq.T + orbit.omega * fourier.derivative(c) @ dv.T
    functions[0] += rest
    return _OfSeries(functions)


@dataclass(frozen=True, eq=False)
class _OfSeries:
    c: Array

    def at(self, tau: Array, derivative: int = 0) -> Array:
        return fourier.synthesis(fourier.highest(self.c), tau, derivative) @ self.c

    @cached_property
    def derivatives(self) -> list[Array]:
        return [fourier.derivative(self.c, order) for order in range(3)]

    def with_slope(self, tau: Array, column: NDArray[np.int_], derivative: int) -> tuple[Array, Array]:
        E = fourier.synthesis(fourier.highest(self.c), tau)
        first, second = (np.einsum("ij,ji->i", E, self.derivatives[derivative + k][:, column]) for k in (0, 1))
        return first, second

    def on_grid(self, H: int, end: float) -> tuple[Array, Array, Array]:
        grid, _, E = _grid(H, end)
        return grid, E @ self.c, E @ self.derivatives[1]

    @property
    def size(self) -> Array:
        return np.asarray(np.abs(self.c).sum(axis=0))

    @property
    def extremes(self) -> tuple[Array, Array]:
        return fourier.extremes(self.c)


@dataclass(frozen=True, eq=False)
class _OfMotion:
    orbit: Orbit
    dq: Array
    dv: Array
    rest: Array

    def at(self, tau: Array, derivative: int = 0) -> Array:
        out = self.orbit.at(tau, derivative) @ self.dq.T + (0.0 if derivative else self.rest)
        if self.dv.any():
            out = out + self.orbit.omega * self.orbit.at(tau, derivative + 1) @ self.dv.T
        return np.asarray(out)

    def with_slope(self, tau: Array, column: NDArray[np.int_], derivative: int) -> tuple[Array, Array]:
        k = np.arange(len(tau))
        return self.at(tau, derivative)[k, column], self.at(tau, derivative + 1)[k, column]

    def on_grid(self, H: int, end: float) -> tuple[Array, Array, Array]:
        grid, wrapped, _ = _grid(H, end)
        return grid, self.at(wrapped), self.at(wrapped, 1)

    @property
    def size(self) -> Array:
        return np.asarray(np.abs(self.extremes).max(axis=0))

    @property
    def extremes(self) -> tuple[Array, Array]:
        values = self.at(self.orbit.motion.phases())
        return values.min(axis=0), values.max(axis=0)


@lru_cache(maxsize=16)
def _grid(H: int, end: float) -> tuple[Array, Array, Array]:
    """Return phases from 0 to end, rad, the same within the period, and the matrix of synthesis there."""
    grid = fourier.phases(max(256, 32 * H))
    grid = np.append(grid[grid < end - 1e-9], end)
    # the first and the last phase of a period must agree, whatever the rounding
    wrapped = np.append(grid[:-1], end if end < 2 * np.pi else 0.0)
    return grid, wrapped, fourier.synthesis(H, wrapped)
