"""Equivalent conicity over the amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
