"""Hysteresis: amplitudes while a parameter falls and rises slowly, and where oscillation dies out and starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Passage:
    """A motion while a parameter changes at a constant rate.

    Attributes
    ----------
    rate : float, unit of the parameter per second
        Negative where the parameter falls.
    values : ndarray, shape (k,), unit of the parameter
        Where the peaks are.
    peaks : ndarray, shape (k,), unit of the coordinate
        The larger of every two successive turning points, as distance from the equilibrium.
    event : float, unit of the parameter
        Falling: where the peaks fall below the level for good. Rising: where they first reach it. NaN where that does
        not happen.
    predicted : float, unit of the parameter
        Rising: where the growth of the linearised system alone brings the disturbance to the level; else NaN.
    status : str
        A sentence.
    """

    rate: float
    values: Array
    peaks: Array
    event: float
    predicted: float
    status: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Hysteresis:
    """Motions while a parameter falls and rises at several rates.

    Attributes
    ----------
    system : str
    parameter, parameter_unit : str
    interval : (float, float), unit of the parameter
    coordinate, unit : str
    level : float, unit of the coordinate
        Peak below which the oscillation has died out, and at which it has started.
    meaning : str
        What the level is, a phrase.
    falling, rising : tuple of Passage
        By falling rate.
    fold : float, unit of the parameter
        Where the stable cycles end; NaN without a fold.
    hopf : float, unit of the parameter
        Where the equilibrium loses its stability; NaN where it does not.
    parameters : dict
        The other parameters' values.
    """

    system: str
    parameter: str
    parameter_unit: str
    interval: tuple[float, float]
    coordinate: str
    unit: str
    level: float
    meaning: str
    falling: tuple[Passage, ...]
    rising: tuple[Passage, ...]
    fold: float
    hopf: float
    parameters: dict[str, float]

    @property
    def rates(self) -> Array:
        """Magnitudes of the rates, shape (rates,), unit of the parameter per second."""
        return np.array([p.rate for p in self.rising])

    @property
    def late_falling(self) -> Array:
        """How far below the fold oscillation dies out, shape (rates,), unit of the parameter; NaN where unknown."""
        return self.fold - np.array([p.event for p in self.falling])

    @property
    def late_rising(self) -> Array:
        """How far beyond the Hopf point oscillation starts, shape (rates,), unit of the parameter; NaN where none."""
        return np.array([p.event for p in self.rising]) - self.hopf

    def exponents(self, late: Array) -> Array:
        """Return n of ``late = c rate**n`` between neighbouring rates, shape (rates - 1,); NaN where unknown.

        Parameters
        ----------
        late : ndarray, shape (rates,), unit of the parameter
            `late_falling` or `late_rising`.
        """
        known = np.where(late > 0, late, np.nan)
        return np.asarray(np.diff(np.log(known)) / np.diff(np.log(self.rates)))
