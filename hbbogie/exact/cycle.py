"""An exact cycle as plain data: contact states, durations and the start determine the whole motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import brief
from hbbogie.stability.exponential import exponentials

Array = NDArray[np.float64]

FINE = 64  # samples of a phase in the search for extremes
GAUSS = 16  # quadrature points in a piece of a phase
PIECE = 3.0  # longest piece, measured by the size of A h and by the phase of the highest harmonic


@dataclass(frozen=True, eq=False)
class ExactCycle:
    """A periodic motion that is linear between switchings.

    The state is x = (all coordinates, velocities of those of second order, 1), and dx/dt = A x in each phase.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    sides : ndarray of bool, shape (S, K)
        Contact state of each phase: on which side of each surface the motion is.
    events : tuple of int, S of them
        The surface that ends each phase.
    sigma : {1, -1}
        -1 if the phases make up half a period, which the other half repeats with the opposite sign.
    start : ndarray, shape (N,), units of the states
    durations : ndarray, shape (S,), s
    matrices : ndarray, shape (S, N, N), 1/s
        A of each phase.
    parameters : dict
        Value of every parameter.
    """

    coordinates: tuple[str, ...]
    sides: NDArray[np.bool_]
    events: tuple[int, ...]
    sigma: int
    start: Array
    durations: Array
    matrices: Array
    parameters: dict[str, float]

    __repr__ = brief

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def span(self) -> float:
        """Total duration of the phases, a period or half of it [s]."""
        return float(self.durations.sum())

    @property
    def period(self) -> float:
        """Period [s]."""
        return self.span * (2 if self.sigma < 0 else 1)

    @property
    def omega(self) -> float:
        """Frequency [rad/s]."""
        return 2 * np.pi / self.period

    @cached_property
    def nodes(self) -> Array:
        """States at the beginning of each phase, and at the end of the last, shape (S + 1, N)."""
        E = self._flow(np.arange(len(self.durations)), self.durations)
        x = [self.start]
        for e in E:
            x.append(e @ x[-1])
        return np.array(x)

    def _flow(self, phase: NDArray[np.int_], t: Array) -> Array:
        """Return the transitions over times from the beginning of phases, shape (len(t), N, N)."""
        return exponentials(self.matrices[None], phase, t[None])[-1][0]

    def _at(self, t: ArrayLike) -> tuple[Array, NDArray[np.int_]]:
        """Return states and phases at the times t [s], counted from the start."""
        wrapped: Array = np.mod(np.atleast_1d(np.asarray(t, dtype=float)), self.period)
        second = wrapped >= self.span
        local = np.where(second, wrapped - self.span, wrapped)
        ends = np.cumsum(self.durations)
        phase = np.minimum(np.searchsorted(ends, local, side="right"), len(ends) - 1)
        x = (self._flow(phase, local - (ends - self.durations)[phase]) @ self.nodes[phase][..., None])[..., 0]
        x[second, :-1] *= self.sigma
        return x, np.where(second, phase + len(ends), phase)

    def _rates(self, x: Array, phase: NDArray[np.int_], order: int) -> Array:
        """Return time derivatives of the states; those in the second half take the constant forces that act there."""
        S = len(self.durations)
        flip = np.where(phase >= S, self.sigma, 1)[:, None]
        x = np.append(x[:, :-1] * flip, x[:, -1:], axis=1)
        for _ in range(order):
            x = (self.matrices[phase % S] @ x[..., None])[..., 0]
        return x * flip

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates at the times t [s], shape (len(t), n)."""
        return self._at(t)[0][:, : self.n]

    def v(self, t: ArrayLike) -> Array:
        """Return the velocities at the times t [s], shape (len(t), n)."""
        return self._rates(*self._at(t), 1)[:, : self.n]

    def a(self, t: ArrayLike) -> Array:
        """Return the accelerations at the times t [s], shape (len(t), n)."""
        return self._rates(*self._at(t), 2)[:, : self.n]

    def extremes(self) -> tuple[Array, Array]:
        """Return the smallest and largest value of each coordinate over the period, each of shape (n,)."""
        x = self.nodes[:-1, None]
        for e in exponentials_of_halves(self.matrices, self.durations, FINE):
            x = np.stack([x, x @ e.swapaxes(-1, -2)], axis=2).reshape(len(x), -1, x.shape[-1])
        x = np.concatenate([x, self.nodes[1:, None]], axis=1)
        rate = (x @ self.matrices.swapaxes(-1, -2))[..., : self.n]
        phase, j, i = np.nonzero(rate[:, :-1] * rate[:, 1:] < 0)
        lowest, highest = x[..., : self.n].min(axis=(0, 1)), x[..., : self.n].max(axis=(0, 1))
        if len(phase):
            turning = self._turning(phase, x[phase, j], i)
            np.minimum.at(lowest, i, turning)
            np.maximum.at(highest, i, turning)
        if self.sigma < 0:
            lowest, highest = np.minimum(lowest, -highest), np.maximum(highest, -lowest)
        return lowest, highest

    def _turning(self, phase: NDArray[np.int_], x: Array, i: NDArray[np.int_]) -> Array:
        """Return coordinates i where their rates vanish within one sample after states x, by safeguarded Newton."""
        step, k = (self.durations / FINE)[phase], np.arange(len(phase))
        low, high, t = np.zeros(len(phase)), step, 0.5 * step
        rising = (self.matrices[phase] @ x[..., None])[k, i, 0] > 0
        for _ in range(60):
            here = self._flow(phase, t) @ x[..., None]
            rate = self.matrices[phase] @ here
            first, second = rate[k, i, 0], (self.matrices[phase] @ rate)[k, i, 0]
            before = (first > 0) == rising
            low, high = np.where(before, t, low), np.where(before, high, t)
            new = t - np.divide(first, second, out=np.full_like(t, np.inf), where=second != 0)
            new = np.where((new > low) & (new < high), new, 0.5 * (low + high))
            moved, t = np.abs(new - t) / step, new
            if moved.max() < 1e-12:
                break
        return np.asarray(here[k, i, 0])

    def amplitude(self, coordinate: str) -> float:
        """Return the peak, the largest absolute value over the period, of a coordinate [its unit]."""
        i = self.coordinates.index(coordinate)
        low, high = self.extremes()
        return float(max(-low[i], high[i]))

    def _quadrature(self, H: int) -> tuple[Array, Array, Array]:
        """Return times, weights and coordinates for integrals over the phases, fine enough for harmonic H."""
        size = np.abs(np.linalg.eigvals(self.matrices)).max(axis=1)
        pieces = np.ceil(np.maximum(size, H * self.omega) * np.abs(self.durations) / PIECE).astype(int).clip(1)
        s, w = legendre.leggauss(GAUSS)
        times, weights, states = [], [], []
        begins = np.cumsum(self.durations) - self.durations
        for i, k in enumerate(pieces):
            step = self.durations[i] / k
            E = self._flow(np.full(GAUSS + 1, i), np.append(step * (s + 1) / 2, step))
            x, ahead = self.nodes[i][:, None], E[-1]
            while x.shape[1] < k:  # states at the beginning of each piece, their number doubled each time
                x, ahead = np.hstack([x, ahead @ x]), ahead @ ahead
            times.append((begins[i] + step * (np.arange(k)[:, None] + (s + 1) / 2)).ravel())
            weights.append(np.tile(step * w / 2, k))
            states.append((E[:-1, : self.n] @ x[:, :k]).transpose(2, 0, 1).reshape(-1, self.n))
        return np.concatenate(times), np.concatenate(weights), np.concatenate(states)

    def mean(self) -> Array:
        """Return the mean of each coordinate over the period, shape (n,)."""
        if self.sigma < 0:
            return np.zeros(self.n)
        _, w, q = self._quadrature(1)
        return np.asarray(w @ q / self.span)

    def rms(self) -> Array:
        """Return the root mean square of each coordinate over the period, shape (n,)."""
        _, w, q = self._quadrature(1)
        return np.sqrt(w @ q**2 / self.span)

    def coefficients(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, mean, cos 1, sin 1, cos 2, ..., shape (2 H + 1, n)."""
        t, w, q = self._quadrature(H)
        out, h = np.zeros((2 * H + 1, self.n)), np.arange(1, H + 1)
        h = h[h % 2 == 1] if self.sigma < 0 else h
        angle = np.outer(self.omega * t, h)
        scale = (w / self.span)[:, None]
        out[0] = 0.0 if self.sigma < 0 else w @ q / self.span
        out[2 * h - 1], out[2 * h] = 2 * (scale * np.cos(angle)).T @ q, 2 * (scale * np.sin(angle)).T @ q
        return out


def exponentials_of_halves(A: Array, h: Array, parts: int) -> list[Array]:
    """Return the transitions over h / 2, h / 4, ... h / parts, each of shape (S, N, N); parts is a power of 2."""
    S, levels = len(h), []
    E = exponentials(A[None], np.arange(S), h[None] / parts)[-1][0]
    for _ in range(parts.bit_length() - 1):
        levels.append(E)
        E = E @ E
    return levels[::-1]
