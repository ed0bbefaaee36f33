"""A motion as a polynomial on each interval of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.polynomials import evaluated, gauss
from hbbogie.results.periodic import repeats_with_opposite_sign

Array = NDArray[np.float64]
ORDERS = (15, 31, 63)  # highest harmonics of a series that shows the motion; the first that resolves it, or the last
RESOLVED = 1e-7  # largest sum of the harmonics left out, relative to the peak
BLOCK = 16  # harmonics integrated at once
FINE = 8  # samples of an interval among which extremes are looked for
REFINED = 6  # steps of Newton's method for them
PIECE = 2.0  # phase [rad] of the highest harmonic over which a piece of an interval is integrated at once


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """A periodic motion as polynomials of degree m on N intervals, over the phase tau = omega t.

    Attributes
    ----------
    second_order : ndarray of bool, shape (n,)
        Whether the rate of each coordinate is a polynomial of its own, as a state of the equations it solves.
    mesh : ndarray, shape (N + 1,)
        Shares of the period, from 0 to 1.
    values : ndarray, shape (N, m + 1, n_states), units of the coordinates
        The coordinates, then the derivatives in tau of those of second order, at the beginnings of the intervals and at
        their m Gauss points.
    """

    form: ClassVar[str] = "piecewise polynomial"
    second_order: NDArray[np.bool_]
    mesh: Array
    values: Array

    __repr__ = brief

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.second_order)

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return self.values.shape[1] - 1

    @cached_property
    def H(self) -> int:
        """Highest harmonic of a series that shows the motion, the first of 15, 31, 63 that resolves it, or 63."""
        c = self.coefficients(ORDERS[-1])
        peak = np.abs(self.extremes).max(axis=0)
        waves = np.hypot(c[1::2], c[2::2])[:, peak > 1e-12 * peak.max()] / peak[peak > 1e-12 * peak.max()]
        return next((k for k in ORDERS if (waves[k:].sum(axis=0) <= RESOLVED).all()), ORDERS[-1])

    def at(self, tau: Array, derivative: int = 0) -> Array:
        """Return the coordinates, or a derivative of theirs in tau, at phases tau [rad], shape (len(tau), n)."""
        s = np.mod(tau / (2 * np.pi), 1.0)
        x = evaluated(self.mesh, self.values, s, derivative)[:, : self.n] / (2 * np.pi) ** derivative
        if derivative and self.second_order.any():
            rate = evaluated(self.mesh, self.values, s, derivative - 1)[:, self.n :]
            x[:, self.second_order] = rate / (2 * np.pi) ** (derivative - 1)
        return x

    def phases(self) -> Array:
        """Return phases from 0 to 2 pi, some in each interval, shape (K,) [rad]."""
        parts = np.diff(self.mesh)[:, None] * np.arange(FINE) / FINE
        return 2 * np.pi * np.append((self.mesh[:-1, None] + parts).ravel(), 1.0)

    @cached_property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each coordinate, each of shape (n,)."""
        g = gauss(self.degree)
        x = np.asarray(g.basis(np.linspace(0, 1, FINE + 1)) @ self.values[..., : self.n])
        every, found = np.arange(self.n), []
        for best in (x.reshape(-1, self.n).argmin(axis=0), x.reshape(-1, self.n).argmax(axis=0)):
            i, k = np.unravel_index(best, x.shape[:2])
            longest = np.diff(self.mesh)[i] / FINE
            s = self.mesh[i] + k * longest
            for _ in range(REFINED):  # also into the next interval
                first, second = (evaluated(self.mesh, self.values, s % 1.0, d)[every, every] for d in (1, 2))
                step = np.divide(-first, second, out=np.zeros_like(first), where=second != 0)
                s = s + np.clip(step, -longest, longest)
            found.append(evaluated(self.mesh, self.values, s % 1.0)[every, every])
        return np.minimum(found[0], x.min(axis=(0, 1))), np.maximum(found[1], x.max(axis=(0, 1)))

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
        """Return the mean of each coordinate, shape (n,)."""
        _, w, q = self._quadrature(np.ones(len(self.values), dtype=int))
        return np.asarray(w @ q)

    def rms(self) -> Array:
        """Return the root mean square of each coordinate, shape (n,)."""
        _, w, q = self._quadrature(np.ones(len(self.values), dtype=int))
        return np.sqrt(w @ q**2)

    def coefficients(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, mean, cos 1, sin 1, cos 2, ..., shape (2 H + 1, n)."""
        s, w, q = self._quadrature(np.ceil(2 * np.pi * H * np.diff(self.mesh) / PIECE).astype(int).clip(1))
        out, weighted, turn = np.empty((2 * H + 1, self.n)), 2 * w[:, None] * q, np.exp(-2j * np.pi * s)
        out[0] = w @ q
        block = turn[:, None] ** np.arange(1, min(H, BLOCK) + 1)
        ahead = block[:, -1:]
        for h in range(1, H + 1, BLOCK):
            c, last = block.T @ weighted, min(h + BLOCK - 1, H)
            some = c[: last - h + 1]
            out[2 * h - 1 : 2 * last : 2], out[2 * h : 2 * last + 1 : 2] = some.real, -some.imag
            block = block * ahead
        return out

    def is_odd(self, tolerance: float) -> bool:
        """Tell whether the second half of the period repeats the first with the opposite sign."""
        return repeats_with_opposite_sign(self, tolerance)

    def numbers(self) -> dict[str, Array]:
        """Return all that determines the motion, to be stored."""
        return {"second_order": self.second_order.astype(float), "mesh": self.mesh, "values": self.values}

    @staticmethod
    def of_numbers(stored: dict[str, Array]) -> PiecewisePolynomial:
        """Return the motion that `numbers` stored, of which the shapes may have been lost."""
        second, mesh = stored["second_order"] > 0, stored["mesh"]
        states = len(second) + int(second.sum())
        return PiecewisePolynomial(second, mesh, stored["values"].reshape(len(mesh) - 1, -1, states))
