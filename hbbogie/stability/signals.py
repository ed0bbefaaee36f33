"""Linear functions of positions and velocities along orbits, in whichever form their motions are stored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.results import Orbit
from hbbogie.results.periodic import FourierSeries

Array = NDArray[np.float64]
Places = int | NDArray[np.int_]


class Signals(Protocol):
    """M functions of the phase for each of P orbits.

    Phases come with the place of the orbit to which each belongs, ``of``: in increasing order, or one for all.
    """

    def at(self, tau: Array, derivative: int = 0, of: Places = 0) -> Array:
        """Return the functions, or a derivative of theirs in tau, at phases tau [rad], shape (len(tau), M)."""

    def with_slope(
        self, tau: Array, column: NDArray[np.int_], derivative: int, of: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        """Return one function, or a derivative of it, at each of some phases, and the next derivative there."""

    def on_grid(self, H: int, end: float) -> tuple[Array, Array, Array]:
        """Return phases from 0 to end, fine enough for harmonic H, and functions and derivatives, shape (P, G, M)."""

    @property
    def bend(self) -> Array:
        """Bound on the absolute value of the second derivative of each, shape (P, M); infinite where none is known."""

    @property
    def size(self) -> Array:
        """Bound on the absolute value of each, shape (P, M), close to the largest."""

    @property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each, each of shape (P, M)."""


def signals(orbits: Sequence[Orbit], dq: Array, dv: Array, rest: Array) -> Signals:
    """Return the functions dq q + dv v + rest along orbits.

    Parameters
    ----------
    orbits : sequence of Orbit
    dq, dv : ndarray, shape (P, M, n)
    rest : ndarray, shape (P, M)
    """
    if any(orbit.advance or not isinstance(orbit.motion, FourierSeries) for orbit in orbits):
        return _OfMotions(tuple(orbits), dq, dv, rest)
    H = max(orbit.H for orbit in orbits)
    c = np.stack([orbit.harmonics(H) for orbit in orbits], axis=1)
    rates = fourier.derivative(c) * np.array([orbit.omega for orbit in orbits])[:, None]
    q, v = (x.transpose(1, 0, 2) @ d.transpose(0, 2, 1) for x, d in ((c, dq), (rates, dv)))
    functions = q + v
    functions[:, 0] += rest
    return _OfSeries(functions)


def _each(of: Places, count: int) -> Iterator[tuple[int, slice]]:
    """Return the orbits to which phases belong, each with the slice of its phases."""
    if isinstance(of, int):
        return iter([(of, slice(None))])
    ends = np.searchsorted(of, np.arange(count + 1))
    return ((k, slice(a, b)) for k, (a, b) in enumerate(pairwise(ends.tolist())) if b > a)


@dataclass(frozen=True, eq=False)
class _OfSeries:
    c: Array  # shape (P, 2 H + 1, M)

    @property
    def H(self) -> int:
        return (self.c.shape[1] - 1) // 2

    def at(self, tau: Array, derivative: int = 0, of: Places = 0) -> Array:
        # cycles of a branch have many phases in common
        alone = isinstance(of, int) or len(self.c) == 1
        phases, place = (tau, slice(None)) if alone else np.unique(tau, return_inverse=True)
        E, out = fourier.synthesis(self.H, phases, derivative)[place], np.empty((len(tau), self.c.shape[2]))
        for k, own in _each(of, len(self.c)):
            out[own] = E[own] @ self.c[k]
        return out

    @cached_property
    def derivatives(self) -> Array:
        orders = [self.c.swapaxes(0, 1)]
        for _ in range(2):
            orders.append(fourier.derivative(orders[-1]))
        return np.stack(orders).swapaxes(1, 2)

    def with_slope(
        self, tau: Array, column: NDArray[np.int_], derivative: int, of: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        both = self.derivatives[derivative : derivative + 2, of, :, column]  # shape (len(tau), 2, 2 H + 1)
        first, second = (both @ fourier.synthesis(self.H, tau)[:, :, None])[:, :, 0].T
        return first, second

    def on_grid(self, H: int, end: float) -> tuple[Array, Array, Array]:
        grid, _, E = _grid(H, end)
        return grid, E @ self.c, E @ self.derivatives[1]

    @property
    def bend(self) -> Array:
        return np.asarray(np.abs(self.derivatives[2]).sum(axis=1))

    @property
    def size(self) -> Array:
        return np.asarray(np.abs(self.c).sum(axis=1))

    @property
    def extremes(self) -> tuple[Array, Array]:
        P, rows, M = self.c.shape
        low, high = fourier.extremes(self.c.swapaxes(0, 1).reshape(rows, P * M))
        return low.reshape(P, M), high.reshape(P, M)


@dataclass(frozen=True, eq=False)
class _OfMotions:
    orbits: tuple[Orbit, ...]
    dq: Array
    dv: Array
    rest: Array

    def at(self, tau: Array, derivative: int = 0, of: Places = 0) -> Array:
        out = np.empty((len(tau), self.rest.shape[1]))
        for k, own in _each(of, len(self.orbits)):
            out[own] = self._of_one(k, tau[own], derivative)
        return out

    def _of_one(self, k: int, tau: Array, derivative: int) -> Array:
        orbit, dq, dv = self.orbits[k], self.dq[k], self.dv[k]
        out = orbit.at(tau, derivative) @ dq.T + (0.0 if derivative else self.rest[k])
        if dv.any():
            out = out + orbit.omega * orbit.at(tau, derivative + 1) @ dv.T
        return np.asarray(out)

    def with_slope(
        self, tau: Array, column: NDArray[np.int_], derivative: int, of: NDArray[np.int_]
    ) -> tuple[Array, Array]:
        k = np.arange(len(tau))
        return self.at(tau, derivative, of)[k, column], self.at(tau, derivative + 1, of)[k, column]

    def on_grid(self, H: int, end: float) -> tuple[Array, Array, Array]:
        grid, wrapped, _ = _grid(H, end)
        values, slopes = (
            np.stack([self._of_one(k, wrapped, order) for k in range(len(self.orbits))]) for order in (0, 1)
        )
        return grid, values, slopes

    @property
    def bend(self) -> Array:
        return np.full(self.rest.shape, np.inf)

    @property
    def size(self) -> Array:
        return np.asarray(np.abs(self.extremes).max(axis=0))

    @property
    def extremes(self) -> tuple[Array, Array]:
        values = [self._of_one(k, orbit.motion.phases(), 0) for k, orbit in enumerate(self.orbits)]
        return np.array([v.min(axis=0) for v in values]), np.array([v.max(axis=0) for v in values])


@lru_cache(maxsize=16)
def _grid(H: int, end: float) -> tuple[Array, Array, Array]:
    """Return phases from 0 to end, rad, the same within the period, and the matrix of synthesis there."""
    grid = fourier.phases(max(256, 32 * H))
    grid = np.append(grid[grid < end - 1e-9], end)
    # the first and the last phase of a period must agree, whatever the rounding
    wrapped = np.append(grid[:-1], end if end < 2 * np.pi else 0.0)
    return grid, wrapped, fourier.synthesis(H, wrapped)
