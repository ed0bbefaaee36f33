"""Motions in time, and quantities derived from them: crossings, period, amplitude."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import lines
from hbbogie.errors import ModelError, named
from hbbogie.results.naming import NAMELESS, Naming
from hbbogie.results.pictures import draw, page
from hbbogie.units import behind, readable

Array = NDArray[np.float64]
SHOWN = 8  # coordinates shown at most


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion in time.

    Attributes
    ----------
    system : str
    coordinates, units : tuple of str
    t : ndarray, shape (N,), s
    q : ndarray, shape (N, n), unit of the coordinate
    v : ndarray, shape (N, n), unit of the coordinate per second
    parameters : dict
    method : str
    naming : Naming
        Units and descriptions of coordinates and parameters, as far as they are known.
    """

    system: str
    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    q: Array
    v: Array
    parameters: dict[str, float] = field(default_factory=dict)
    method: str = ""
    naming: Naming = NAMELESS

    def __repr__(self) -> str:
        ranges = []
        for i, own in enumerate(self.units[:SHOWN]):
            factor, unit = readable(own, float(np.abs(self.q[:, i]).max(initial=0.0)))
            low, high = factor * self.q[:, i].min(), factor * self.q[:, i].max()
            ranges.append(f"{self.coordinates[i]} {low:.4g} to {high:.4g}{behind(unit)}")
        more = len(self.coordinates) - len(ranges)
        return lines(
            f"Motion of {self.system} at {self.naming.values(self.parameters)}".removesuffix(" at "),
            f"{len(self.t)} samples from {self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) else "no samples",
            ", ".join(ranges) + (f" and {more} more" if more else "") if len(self.t) else "",
            self.method,
        )

    def _repr_html_(self) -> str:
        return page(repr(self), (), "time_history", self) if len(self.t) > 1 else page(repr(self))

    def plot(self, **options: Any) -> Any:
        """Draw coordinates over time; options and the axes returned as of `hbbogie.plot.time_history`."""
        return draw("time_history", self, **options)

    def index(self, coordinate: str) -> int:
        """Return the place of a coordinate, by its name."""
        name = named(f"trajectory of {self.system!r}", "coordinate", coordinate, self.coordinates)
        return self.coordinates.index(name)

    def at(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return coordinates and velocities at the times t [s], each of shape (len(t), n).

        Cubic Hermite interpolation between the samples: positions good to the fourth, velocities to the
        third power of the sample distance.
        """
        t = np.atleast_1d(np.asarray(t, dtype=float))
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, None]
        s = (t - self.t[k])[:, None] / h
        b, c, d = self._cubic(k)
        return self.q[k] + s * (b + s * (c + s * d)), (b + s * (2 * c + s * 3 * d)) / h

    def _cubic(self, k: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        """Return b, c, d of ``q + b s + c s^2 + d s^3``, s from 0 to 1, between the samples k and k + 1."""
        h = (self.t[k + 1] - self.t[k])[:, None]
        rise, v0, v1 = self.q[k + 1] - self.q[k], h * self.v[k], h * self.v[k + 1]
        return v0, 3 * rise - 2 * v0 - v1, v0 + v1 - 2 * rise

    def crossings(self, coordinate: str, level: float | None = None) -> Array:
        """Return the times at which a coordinate crosses a level upwards, shape (crossings,), s.

        Parameters
        ----------
        coordinate : str
        level : float, unit of the coordinate
            The mean over the last period where left out.
        """
        i = self.index(coordinate)
        if level is None:
            level = float(self.q[len(self.t) // 2 :, i].mean())
            # the mean of a stretch that is no whole number of periods is off: once more over the last period
            found = self.crossings(coordinate, level)
            if len(found) > 1:
                level = float(self.at(np.linspace(found[-2], found[-1], 256, endpoint=False))[0][:, i].mean())
        above = self.q[:, i] >= level
        k = np.flatnonzero(~above[:-1] & above[1:])
        b, c, d = (x[:, i] for x in self._cubic(k))
        low, high = np.zeros(len(k)), np.ones(len(k))
        for _ in range(53):
            s = 0.5 * (low + high)
            below = self.q[k, i] - level + s * (b + s * (c + s * d)) < 0
            low, high = np.where(below, s, low), np.where(below, high, s)
        return np.asarray(self.t[k] + high * (self.t[k + 1] - self.t[k]))

    @staticmethod
    def recurrence(states: Array) -> int:
        """Return after how many crossings a motion recurs: 1 for a plain oscillation.

        Parameters
        ----------
        states : ndarray, shape (crossings, k), relative to the range of each column
            States at successive crossings, at least two.
        """
        states = states[-24:]
        shifts = range(1, min(6, len(states) - 1) + 1)
        gaps = np.array([np.abs(states[m:] - states[:-m]).max(axis=1).min() for m in shifts])
        # the shortest that is about as good as the best: a transient must not pass for a long period
        return 1 + int(np.argmax(gaps <= max(2 * gaps.min(), 1e-3)))

    def period(self, coordinate: str | None = None, periods: int = 1) -> float:
        """Return the mean of the last periods [s], from upward crossings of a coordinate's mean.

        Parameters
        ----------
        coordinate : str
            The first where left out.
        periods : int
            Number of periods to average over.

        Raises
        ------
        ModelError
            When the motion does not hold so many periods.
        """
        name = self.coordinates[0] if coordinate is None else coordinate
        times, m = self.crossings(name), 1
        if len(times) > 1:
            scale = np.maximum(np.ptp(np.hstack([self.q, self.v]), axis=0), np.finfo(float).tiny)
            # one sample later: where a rate jumps at the crossing, that between the samples means nothing
            later = np.minimum(times[-24:] + (self.t[1] - self.t[0]), self.t[-1])
            m = self.recurrence(np.hstack(self.at(later)) / scale) * max(1, periods)
        if len(times) <= m:
            raise ModelError(
                f"trajectory of {self.system!r}: {name!r} crosses its mean upwards {len(times)} times in "
                f"{self.t[-1] - self.t[0]:g} s; {max(1, periods)} period(s) need {m + 1}. Simulate longer, "
                "or choose another coordinate."
            )
        return float((times[-1] - times[-1 - m]) / max(1, periods))

    @property
    def omega(self) -> float:
        """Frequency 2 pi / period of the first coordinate [rad/s]."""
        return 2 * np.pi / self.period()

    def amplitude(self, coordinate: str, periods: int | None = None, *, since: float | None = None) -> float:
        """Return the largest absolute value of a coordinate [its unit], also between the samples.

        Parameters
        ----------
        coordinate : str
        periods : int
            Look at the last so many periods only; at the whole motion where left out.
        since : float, s
            Look at the motion from this time on only.
        """
        i = self.index(coordinate)
        start = self.t[0] if since is None else since
        if periods is not None:
            start = self.t[-1] - periods * self.period(coordinate)
        k = np.flatnonzero(self.t[1:] > start)
        k = k[np.sign(self.v[k, i]) != np.sign(self.v[k + 1, i])]
        b, c, d = (x[:, i] for x in self._cubic(k))
        # the velocity b + 2 c s + 3 d s^2 has one zero between 0 and 1; in this form it loses no digits
        root = np.sqrt(np.maximum(c**2 - 3 * b * d, 0.0))
        below = -c + np.where(b >= 0, root, -root)
        s = np.clip(np.divide(b, below, out=np.zeros_like(b), where=below != 0), 0.0, 1.0)
        peaks = self.q[k, i] + s * (b + s * (c + s * d))
        return float(max(np.abs(self.q[self.t >= start, i]).max(initial=0.0), np.abs(peaks).max(initial=0.0)))
