"""A cycle as a piecewise polynomial: plain data that answers everything about the motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie import fourier
from hbbogie.brief import brief
from hbbogie.collocation.mesh import equidistributed, evaluated, gauss, points_of
from hbbogie.model.system import System
from hbbogie.results.orbit import Orbit, Stability

Array = NDArray[np.float64]
ORDERS = (15, 31, 63, 127, 255, 511)  # highest harmonics of an orbit, the first that resolves it is taken
TRIED = (63, 511)  # those for which the distance is measured
LOOKED = 4  # samples, one of so many, at which the distance of the series is measured
BLOCK = 16  # harmonics integrated at once
RESOLVED = 1e-7  # largest distance of the Fourier series, relative to the range
FINE = 8  # samples of an interval among which extremes are looked for
REFINED = 4  # steps of Newton's method for them
PIECE = 2.0  # phase [rad] of the highest harmonic over which a piece of an interval is integrated at once


@dataclass(frozen=True, eq=False)
class CollocatedCycle:
    """A periodic motion as a polynomial on each interval of a mesh.

    The state is x = (all coordinates, velocities of those of second order).

    Attributes
    ----------
    system : str
        Name of the system.
    coordinates, units : tuple of str
        Names and units of the n coordinates.
    second_order : tuple of bool
        Whether the state holds the velocity of each coordinate.
    mesh : ndarray, shape (N + 1,)
        Shares of the period, from 0 to 1.
    values : ndarray, shape (N, m + 1, n_states), units of the states
        At the beginnings of the intervals and at their m Gauss points.
    period : float, s
    parameters : dict
        Value of every parameter.
    residual : float
        Largest scaled residual.
    period_error, waveform_error : float
        Estimates, relative to the period and to the range of each state, by a Newton step at the next degree.
    stability : Stability or None
    status : str
        How it was computed, a sentence.
    """

    system: str
    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    second_order: tuple[bool, ...]
    mesh: Array
    values: Array
    period: float
    parameters: dict[str, float]
    residual: float = float("nan")
    period_error: float = float("nan")
    waveform_error: float = float("nan")
    stability: Stability | None = None
    status: str = ""

    __repr__ = brief

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return self.values.shape[1] - 1

    @property
    def omega(self) -> float:
        """Frequency [rad/s]."""
        return 2 * np.pi / self.period

    @property
    def method(self) -> str:
        """What computed it, for people."""
        return f"collocation, {len(self.values)} intervals of degree {self.degree}"

    def on(self, N: int, degree: int) -> CollocatedCycle:
        """Return the same motion on a mesh of N intervals on which its errors are equal."""
        size = np.maximum(np.ptp(self.values, axis=(0, 1)), np.finfo(float).tiny)
        mesh = equidistributed(self.mesh, self.values / size, N)
        return replace(self, mesh=mesh, values=evaluated(self.mesh, self.values, points_of(mesh, degree)))

    def _at(self, t: ArrayLike, derivative: int = 0) -> Array:
        s = np.mod(np.atleast_1d(np.asarray(t, dtype=float)) / self.period, 1.0)
        return evaluated(self.mesh, self.values, s, derivative) / self.period**derivative

    def states(self, t: ArrayLike) -> Array:
        """Return the states at the times t [s], shape (len(t), n_states)."""
        return self._at(t)

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates at the times t [s], shape (len(t), n)."""
        return self._at(t)[:, : self.n]

    def v(self, t: ArrayLike) -> Array:
        """Return the velocities at the times t [s], shape (len(t), n)."""
        v = self._at(t, 1)[:, : self.n]
        v[:, list(self.second_order)] = self._at(t)[:, self.n :]
        return v

    def a(self, t: ArrayLike) -> Array:
        """Return the accelerations at the times t [s], shape (len(t), n)."""
        a = self._at(t, 2)[:, : self.n]
        a[:, list(self.second_order)] = self._at(t, 1)[:, self.n :]
        return a

    @cached_property
    def _samples(self) -> Array:
        """The coordinates at equal distances in each interval, ends included, shape (N, FINE + 1, n)."""
        basis = gauss(self.degree).basis(np.linspace(0, 1, FINE + 1))
        return np.asarray(basis @ self.values[..., : self.n])

    def extremes(self) -> tuple[Array, Array]:
        """Return the smallest and largest value of each coordinate over the period, each of shape (n,)."""
        x, every, found = self._samples, np.arange(self.n), []
        for best in (x.reshape(-1, self.n).argmin(axis=0), x.reshape(-1, self.n).argmax(axis=0)):
            i, k = np.unravel_index(best, x.shape[:2])
            theta, values = k / FINE, self.values[i, :, every]
            for _ in range(REFINED):
                first, second = ((gauss(self.degree).basis(theta, d) * values).sum(axis=1) for d in (1, 2))
                step = np.divide(-first, second, out=np.zeros_like(first), where=second != 0)
                theta = np.clip(theta + np.clip(step, -1 / FINE, 1 / FINE), 0.0, 1.0)
            found.append((gauss(self.degree).basis(theta) * values).sum(axis=1))
        lowest, highest = x.min(axis=(0, 1)), x.max(axis=(0, 1))
        return np.minimum(found[0], lowest), np.maximum(found[1], highest)

    def mark(self) -> Array:
        """Return frequency [rad/s], then means, smallest and largest values of the coordinates, shape (1 + 3 n,)."""
        return np.concatenate([[self.omega], self.mean(), *self.extremes()])

    def amplitude(self, coordinate: str) -> float:
        """Return the peak, the largest absolute value over the period, of a coordinate [its unit]."""
        i, (low, high) = self.coordinates.index(coordinate), self.extremes()
        return float(max(-low[i], high[i]))

    def _quadrature(self, pieces: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        """Return shares of the period, weights and coordinates, each interval divided into pieces."""
        g, i = gauss(self.degree + 2), np.repeat(np.arange(len(pieces)), pieces)
        first = np.cumsum(pieces) - pieces
        theta = ((np.arange(len(i)) - first[i])[:, None] + g.c) / pieces[i, None]
        h = np.diff(self.mesh)[i]
        s, w = self.mesh[i, None] + h[:, None] * theta, (h / pieces[i])[:, None] * g.b
        basis = gauss(self.degree).basis(theta.ravel()).reshape(*theta.shape, -1)
        q = np.einsum("ikm,imn->ikn", basis, self.values[i][..., : self.n])
        return s.ravel(), w.ravel(), q.reshape(-1, self.n)

    def mean(self) -> Array:
        """Return the mean of each coordinate over the period, shape (n,)."""
        _, w, q = self._quadrature(np.ones(len(self.values), dtype=int))
        return np.asarray(w @ q)

    def rms(self) -> Array:
        """Return the root mean square of each coordinate over the period, shape (n,)."""
        _, w, q = self._quadrature(np.ones(len(self.values), dtype=int))
        return np.sqrt(w @ q**2)

    def harmonics(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, mean, cos 1, sin 1, cos 2, ..., shape (2 H + 1, n)."""
        s, w, q = self._quadrature(np.ceil(2 * np.pi * H * np.diff(self.mesh) / PIECE).astype(int).clip(1))
        out, weighted, turn = np.empty((2 * H + 1, self.n)), 2 * w[:, None] * q, np.exp(-2j * np.pi * s)
        out[0] = w @ q
        block = turn[:, None] ** np.arange(1, min(H, BLOCK) + 1)
        ahead = block[:, -1:]
        for h in range(1, H + 1, BLOCK):
            c = block.T @ weighted
            last = min(h + BLOCK - 1, H)
            out[2 * h - 1 : 2 * last : 2], out[2 * h : 2 * last + 1 : 2] = (
                c.real[: last - h + 1],
                -c.imag[: last - h + 1],
            )
            block = block * ahead
        return out

    def orbit(self, H: int | None = None) -> Orbit:
        """Return the cycle as its Fourier series.

        Parameters
        ----------
        H : int, optional
            Highest harmonic; where left out the first of 15, 31, 63, ... that resolves the motion, 511 at most.

        Returns
        -------
        Orbit
            Its period and stability are those of the polynomials; the error of the waveform contains the harmonics
            left out, and the status tells it where they count.
        """
        order, left = 0, 0.0
        samples = self._samples[:, :-1:LOOKED].reshape(-1, self.n)
        s = (self.mesh[:-1, None] + np.diff(self.mesh)[:, None] * np.arange(0, FINE, LOOKED) / FINE).ravel()
        peak = np.maximum(np.abs(samples).max(axis=0), np.finfo(float).tiny)
        moving = peak > 1e-12 * peak.max()

        def off(c: Array) -> float:
            wave = fourier.synthesis(fourier.highest(c), 2 * np.pi * s) @ c
            return float((np.abs(wave - samples).max(axis=0) / peak)[moving].max())

        for order in (H,) if H else TRIED:
            c = self.harmonics(order)
            left = off(c)
            if left <= RESOLVED:
                break
        if not H and left <= RESOLVED:
            tails = (np.hypot(c[1::2], c[2::2]) / peak)[::-1, moving].cumsum(axis=0)[::-1].max(axis=1)
            fewer = next((k for k in ORDERS if k < order and left + tails[k] <= RESOLVED), order)
            c, left, order = fourier.resize(c, fewer), left + (tails[fewer] if fewer < order else 0.0), fewer
        status = self.status
        if left > RESOLVED:
            status += f" Harmonics up to {order} are given; their waveform is off by {left:.1e} of its peak."
        errors = {"omega": self.period_error * self.omega, "waveform": max(self.waveform_error, left)}
        errors |= {c: errors["waveform"] * float(p) for c, p in zip(self.coordinates, peak, strict=True)}
        return Orbit(
            self.system,
            self.coordinates,
            self.units,
            c,
            self.omega,
            dict(self.parameters),
            self.method,
            self.residual,
            status.strip(),
            self.stability,
            errors if np.isfinite(self.period_error) else None,
        )


def cycle_of(
    system: System, mesh: Array, values: Array, period: float, parameters: dict[str, float] | None = None
) -> CollocatedCycle:
    """Return a cycle of a system, at its values where no others are given; not solved for yet."""
    return CollocatedCycle(
        system.name,
        system.coordinate_names,
        tuple(c.unit for c in system.coordinates),
        system.second_order,
        mesh,
        values,
        period,
        dict(system.values) if parameters is None else parameters,
    )
