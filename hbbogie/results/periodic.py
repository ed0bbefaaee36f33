"""Forms of a periodic motion: what each answers, whatever it is stored as; the Fourier series among them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.brief import brief
from hbbogie.errors import ModelError, told

Array = NDArray[np.float64]
HALVES = 512  # pairs of phases half a period apart at which a motion that is no series is compared with itself


class PeriodicMotion(Protocol):
    """A motion of n coordinates over the phase tau = omega t, with period 2 pi; it knows no frequency."""

    form: ClassVar[str]

    @property
    def H(self) -> int:
        """Highest harmonic of a series that shows the motion; 0 for an equilibrium."""

    def at(self, tau: Array, derivative: int = 0) -> Array:
        """Return the coordinates, or a derivative of theirs in tau, at phases tau [rad], shape (len(tau), n)."""

    def phases(self) -> Array:
        """Return phases from 0 to 2 pi, close where the motion is fast, shape (K,) [rad]."""

    @property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each coordinate, each of shape (n,)."""

    def mean(self) -> Array:
        """Return the mean of each coordinate, shape (n,)."""

    def rms(self) -> Array:
        """Return the root mean square of each coordinate, shape (n,)."""

    def coefficients(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, mean, cos 1, sin 1, cos 2, ..., shape (2 H + 1, n)."""

    def is_odd(self, tolerance: float) -> bool:
        """Tell whether q(tau + pi) = -q(tau), up to a distance relative to the largest value."""


@dataclass(frozen=True, eq=False)
class FourierSeries:
    """A motion as the sum of harmonics 0 ... H.

    Attributes
    ----------
    c : ndarray, shape (2 H + 1, n), units of the coordinates
        Mean, cos 1, sin 1, cos 2, ...
    """

    form: ClassVar[str] = "Fourier series"
    c: Array

    __repr__ = brief

    @property
    def H(self) -> int:
        """Highest harmonic; 0 for an equilibrium."""
        return fourier.highest(self.c)

    def at(self, tau: Array, derivative: int = 0) -> Array:
        """Return the coordinates, or a derivative of theirs in tau, at phases tau [rad], shape (len(tau), n)."""
        return fourier.synthesis(self.H, tau, derivative) @ self.c

    def phases(self) -> Array:
        """Return phases from 0 to 2 pi at equal distances, shape (K,) [rad]; the first alone for an equilibrium."""
        return np.linspace(0.0, 2 * np.pi, 1 + max(400, 32 * self.H)) if self.H else np.zeros(1)

    @cached_property
    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest value of each coordinate, each of shape (n,)."""
        return fourier.extremes(self.c)

    def mean(self) -> Array:
        """Return the mean of each coordinate, shape (n,)."""
        return np.array(self.c[0])

    def rms(self) -> Array:
        """Return the root mean square of each coordinate, shape (n,)."""
        return np.sqrt(self.c[0] ** 2 + 0.5 * (self.c[1:] ** 2).sum(axis=0))

    def coefficients(self, H: int) -> Array:
        """Return the Fourier coefficients up to harmonic H, shape (2 H + 1, n)."""
        return self.c if self.H == H else fourier.resize(self.c, H)

    def is_odd(self, tolerance: float) -> bool:
        """Tell whether mean and even harmonics vanish, relative to the largest coefficient."""
        return fourier.is_odd(self.c, tolerance)


def series_of(given: Any) -> FourierSeries:
    """Return the series of an array of coefficients; raise `ModelError` unless it has the shape (2 H + 1, n)."""
    try:
        c = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        c = np.empty(0)
    if c.ndim != 2 or len(c) % 2 == 0:
        got = f"an array of shape {np.shape(given)}" if isinstance(given, np.ndarray) else told(given)
        raise ModelError(
            f"Orbit: got {got} as its motion; give Fourier coefficients, an array of shape (2 H + 1, n) with mean, "
            "cos 1, sin 1, ... of n coordinates, or the motion of another orbit."
        )
    return FourierSeries(c)


def repeats_with_opposite_sign(motion: PeriodicMotion, tolerance: float) -> bool:
    """Tell whether q(tau + pi) = -q(tau) at samples, relative to the largest value."""
    first, second = np.split(motion.at(fourier.phases(2 * HALVES)), 2)
    return bool(np.abs(first + second).max() <= 2 * tolerance * np.abs(first).max(initial=0.0))
