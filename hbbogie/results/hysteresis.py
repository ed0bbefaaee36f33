"""Hysteresis: amplitudes while a parameter slowly falls and rises, and where oscillation dies out and starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines
from hbbogie.results.pictures import draw, page
from hbbogie.units import behind

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

    def __repr__(self) -> str:
        way = "falling" if self.rate < 0 else "rising"
        return lines(f"Passage, {way} by {abs(self.rate):g} per second: event at {self.event:.6g}", self.status)


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

    def __repr__(self) -> str:
        rates, unit = ", ".join(f"{r:g}" for r in self.rates), behind(self.parameter_unit)
        return lines(
            f"Hysteresis of {self.system}: {self.parameter} from {self.interval[0]:g} to {self.interval[1]:g}{unit}",
            f"fold at {self.fold:.6g}, Hopf point at {self.hopf:.6g}{unit}",
            f"rates {rates}; level of {self.coordinate} {self.level:.4g}{behind(self.unit)}: {self.meaning}",
            "dies out at " + ", ".join(f"{p.event:.6g}" for p in self.falling),
            "starts at " + ", ".join(f"{p.event:.6g}" for p in self.rising),
        )

    def _repr_html_(self) -> str:
        return page(repr(self), (), "hysteresis", self)

    def plot(self, **options: Any) -> Any:
        """Draw the runs; options and the axes returned as of `hbbogie.plot.hysteresis`."""
        return draw("hysteresis", self, **options)

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
