"""Equivalent conicity over the amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines
from hbbogie.results.pictures import draw, page

Array = NDArray[np.float64]
SHOWN = 6  # amplitudes shown at most


@dataclass(frozen=True, eq=False)
class Conicity:
    """Equivalent conicity over the amplitude of the wheelset, by three definitions.

    Attributes
    ----------
    amplitude : ndarray, shape (n,), mm
        Half the travel of the wheelset.
    centre : ndarray, shape (n,), mm
        The middle of its travel; 0 for symmetric profiles.
    equivalent : ndarray, shape (n,), 1
        By EN 15302: tan(gamma_e) of the cone that rolls with the same wavelength. NaN where the wheelset does not
        oscillate with this amplitude.
    least_squares : ndarray, shape (n,), 1
        Half the slope of the straight line through the rolling radius difference that is best over the travel.
    harmonic : ndarray, shape (n,), 1
        Half the describing function: what harmonic balance with one harmonic sees.
    """

    amplitude: Array
    centre: Array
    equivalent: Array
    least_squares: Array
    harmonic: Array

    def __repr__(self) -> str:
        pairs = zip(self.amplitude[:SHOWN], self.equivalent, strict=False)
        more = f" and {len(self.amplitude) - SHOWN} more" if len(self.amplitude) > SHOWN else ""
        return lines(
            f"Equivalent conicity at {len(self.amplitude)} amplitudes",
            ", ".join(f"{value:.4g} at {amplitude:g} mm" for amplitude, value in pairs) + more,
        )

    def _repr_html_(self) -> str:
        return page(repr(self), (), "conicity", self)

    def plot(self, **options: Any) -> Any:
        """Draw it over the amplitude; options and the axes returned as of `hbbogie.plot.conicity`."""
        return draw("conicity", self, **options)
