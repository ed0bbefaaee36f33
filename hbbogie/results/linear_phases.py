"""A motion that is linear between switchings: contact states, durations and the start determine all of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.exponential import REACH, exponentials
from hbbogie.results.periodic import repeats_with_opposite_sign

Array = NDArray[np.float64]

HIGHEST = 61  # highest harmonic of a series that shows the motion: it has kinks, and no series resolves them
FINE = 64  # smallest number of samples of a phase
MOST = 1 << 16  # and the largest
DEGREE = 14  # of the Taylor polynomial from one sample to the next
TURNED = 1e-8  # share of a step to which a turning point is found: the value there is good to the square of it
GAUSS = 16  # quadrature points in a piece of a phase
PIECE = 3.0  # longest piece, measured by the size of A h and by the phase of the highest harmonic


@dataclass(frozen=True, eq=False)
class LinearPhases:
    """A periodic motion that is linear between switchings, over the phase tau = omega t.

    The state is x = (all coordinates, velocities of those of second order, 1), and dx/dtau = A x in each of S phases.

    Attributes
    ----------
    n : int
        Number of coordinates.
    sigma : {1, -1}
        -1 if the phases make up half a period, which the other half repeats with the opposite sign.
    sides : ndarray of bool, shape (S, K)
        Contact state of each phase: on which side of each surface the motion is.
    events : ndarray of int, shape (S,)
        The surface that ends each phase.
    start : ndarray, shape (N,), units of the states
    durations : ndarray, shape (S,), rad
    matrices : ndarray, shape (S, N, N), 1/rad
        A of each phase.
    """

    form: ClassVar[str] = "linear phases"
    n: int
    sigma: int
    sides: NDArray[np.bool_]
    events: NDArray[np.int_]
    start: Array
    durations: Array
    matrices: Array

    __repr__ = brief

    @property
    def H(self) -> int:
        """Highest harmonic of a series that shows the motion."""
        return HIGHEST

    @property
    def span(self) -> float:
        """Total duration of the phases, a period or half of it [rad]."""
        return float(self.durations.sum())

    @cached_property
    def begins(self) -> Array:
        """When each phase begins, shape (S,) [rad]."""
        return np.cumsum(self.durations) - self.durations

    @cached_property
    def nodes(self) -> Array:
        """States at the beginning of each phase, and at the end of the last, shape (S + 1, N)."""
        x = [self.start]
        for e in exponentials(self.matrices[None], np.arange(len(self.durations)), self.durations[None])[-1][0]:
            x.append(e @ x[-1])
        return np.array(x)

    @cached_property
    def samples(self) -> list[Array]:
        """States at equal distances in each phase, its end left out, each of shape (number of samples, N)."""
        A2 = self.matrices @ self.matrices
        size = np.linalg.norm(A2 @ A2, axis=(1, 2)) ** 0.25 * np.abs(self.durations) / REACH
        parts = np.array([1 << int(np.ceil(np.log2(s))) for s in np.clip(size, FINE, MOST)])
        ahead = exponentials(self.matrices[None], np.arange(len(parts)), (self.durations / parts)[None])[-1][0]
        return [_powers(e, x, k) for e, x, k in zip(ahead, self.nodes, parts, strict=False)]

    def _ahead(self, phase: NDArray[np.int_], x: Array, t: Array) -> Array:
        """Return the states at short times t after states x of phases, shape (len(t), N)."""
        out = np.empty_like(x)
        for i in np.unique(phase):
            of = phase == i
            term = total = x[of]
            for j in range(1, DEGREE + 1):
                term = term @ self.matrices[i].T * (t[of] / j)[:, None]
                total = total + term
            out[of] = total
        return out

    def at(self, tau: Array, derivative: int = 0) -> Array:
        """Return the coordinates, or a derivative of theirs in tau, at phases tau [rad], shape (len(tau), n)."""
        wrapped: Array = np.mod(tau, 2 * np.pi)
        second = (wrapped >= self.span) & (self.sigma < 0)
        local = np.where(second, wrapped - self.span, wrapped)
        i = np.clip(np.searchsorted(self.begins, local, side="right") - 1, 0, len(self.durations) - 1)
        x, t = np.empty((len(local), len(self.start))), local - self.begins[i]
        for j in np.unique(i):
            of, own = i == j, self.samples[j]
            step = self.durations[j] / len(own)
            # a contact that only touches takes no time
            k = np.clip((t[of] / (step or 1.0)).astype(int), 0, len(own) - 1)
            x[of], t[of] = own[k], t[of] - step * k
        x = self._ahead(i, x, t)
        for _ in range(derivative):
            x = (self.matrices[i] @ x[..., None])[..., 0]
        return np.where(second, self.sigma, 1)[:, None] * x[:, : self.n]

    def phases(self) -> Array:
        """Return phases from 0 to 2 pi, some in each phase between switchings, shape (K,) [rad]."""
        t = (self.begins[:, None] + self.durations[:, None] * np.arange(FINE) / FINE).ravel()
        return np.unique(np.concatenate([t, *([t + self.span] if self.sigma < 0 else []), [2 * np.pi]]))

    @cached_property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each coordinate, each of shape (n,)."""
        every = np.concatenate([*self.samples, self.nodes[-1:]])
        lowest, highest = every[:, : self.n].min(axis=0), every[:, : self.n].max(axis=0)
        if self.sigma < 0:
            lowest, highest = np.minimum(lowest, -highest), np.maximum(highest, -lowest)
        for phase, own in enumerate(self.samples):
            x, step = np.vstack([own, self.nodes[phase + 1]]), self.durations[phase] / len(own)
            q, rate = x[:, : self.n], (x @ self.matrices[phase].T)[:, : self.n]
            rise = step * np.maximum(np.abs(rate[:-1]), np.abs(rate[1:]))  # no turning point lies farther beyond
            beyond = np.maximum(q[:-1], q[1:]) + rise >= highest, np.minimum(q[:-1], q[1:]) - rise <= lowest
            j, i = np.nonzero((rate[:-1] * rate[1:] < 0) & (beyond[0] | beyond[1]))
            if len(j):
                turning = self._turning(phase, x[j], i, step)
                np.minimum.at(lowest, i, turning)
                np.maximum.at(highest, i, turning)
        return (np.minimum(lowest, -highest), np.maximum(highest, -lowest)) if self.sigma < 0 else (lowest, highest)

    def _turning(self, phase: int, x: Array, i: NDArray[np.int_], step: float) -> Array:
        """Return coordinates i where their rates vanish within one step after states x, by safeguarded Newton."""
        k, A, which = np.arange(len(x)), self.matrices[phase].T, np.full(len(x), phase)
        low, high, t = np.zeros(len(x)), np.full(len(x), step), np.full(len(x), 0.5 * step)
        rising = (x @ A)[k, i] > 0
        for _ in range(60):
            here = self._ahead(which, x, t)
            rate = here @ A
            first, second = rate[k, i], (rate @ A)[k, i]
            before = (first > 0) == rising
            low, high = np.where(before, t, low), np.where(before, high, t)
            new = t - np.divide(first, second, out=np.full_like(t, np.inf), where=second != 0)
            there = np.abs(new - t) <= 1e-12 * step  # where round-off may lead out of the bracket
            new = np.where(there | (new > low) & (new < high), new, 0.5 * (low + high))
            moved, t = np.abs(new - t) / step, new
            if moved.max() < TURNED:
                break
        return np.asarray(here[k, i])

    def _quadrature(self, H: int) -> tuple[Array, Array, Array]:
        """Return phases, weights and coordinates for integrals over the span, fine enough for harmonic H."""
        size = np.abs(np.linalg.eigvals(self.matrices)).max(axis=1)
        pieces = np.ceil(np.maximum(size, H) * np.abs(self.durations) / PIECE).astype(int).clip(1)
        s, w = legendre.leggauss(GAUSS)
        phases, weights, states = [], [], []
        for i, k in enumerate(pieces):
            step = self.durations[i] / k
            parts = np.append(step * (s + 1) / 2, step)
            E = exponentials(self.matrices[None], np.full(GAUSS + 1, i), parts[None])[-1][0]
            x = _powers(E[-1], self.nodes[i], k)
            phases.append((self.begins[i] + step * (np.arange(k)[:, None] + (s + 1) / 2)).ravel())
            weights.append(np.tile(step * w / 2, k))
            states.append((E[:-1, : self.n] @ x.T).transpose(2, 0, 1).reshape(-1, self.n))
        return np.concatenate(phases), np.concatenate(weights), np.concatenate(states)

    def mean(self) -> Array:
        """Return the mean of each coordinate, shape (n,)."""
        _, w, q = self._quadrature(1)
        return np.zeros(self.n) if self.sigma < 0 else np.asarray(w @ q / self.span)

    def rms(self) -> Array:
        """Return the root mean square of each coordinate, shape (n,)."""
        _, w, q = self._quadrature(1)
        return np.sqrt(w @ q**2 / self.span)

    def coefficients(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, mean, cos 1, sin 1, cos 2, ..., shape (2 H + 1, n)."""
        tau, w, q = self._quadrature(H)
        out, h = np.zeros((2 * H + 1, self.n)), np.arange(1, H + 1)
        h = h[h % 2 == 1] if self.sigma < 0 else h
        angle, scale = np.outer(tau, h), (w / self.span)[:, None]
        out[0] = 0.0 if self.sigma < 0 else w @ q / self.span
        out[2 * h - 1], out[2 * h] = 2 * (scale * np.cos(angle)).T @ q, 2 * (scale * np.sin(angle)).T @ q
        return out

    def is_odd(self, tolerance: float) -> bool:
        """Tell whether the second half of the period repeats the first with the opposite sign."""
        return self.sigma < 0 or repeats_with_opposite_sign(self, tolerance)

    def numbers(self) -> dict[str, Array]:
        """Return all that determines the motion, to be stored."""
        names = ("n", "sigma", "sides", "events", "start", "durations", "matrices")
        return {name: np.asarray(getattr(self, name), dtype=float) for name in names}

    @staticmethod
    def of_numbers(stored: dict[str, Array]) -> LinearPhases:
        """Return the motion that `numbers` stored, of which the shapes may have been lost."""
        S, N = len(stored["durations"]), len(stored["start"])
        return LinearPhases(
            int(stored["n"][0]),
            int(stored["sigma"][0]),
            stored["sides"].reshape(S, -1) > 0,
            stored["events"].astype(int),
            stored["start"],
            stored["durations"],
            stored["matrices"].reshape(S, N, N),
        )


def _powers(E: Array, x: Array, k: int) -> Array:
    """Return x, E x, E^2 x, ..., k of them, their number doubled each time, shape (k, N)."""
    found, ahead = x[None], E
    while len(found) < k:
        found, ahead = np.vstack([found, found @ ahead.T]), ahead @ ahead
    return found[:k]
