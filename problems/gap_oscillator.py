"""Free mass between two springs behind gaps: a dead band with a periodic motion in closed form.

    m x'' + d x' + F(x) = 0,   F(x) = k (x - delta) for x > delta, 0 inside, k (x + delta) for x < -delta

Without damping the mass crosses the gap at constant velocity and turns on a spring in half a period
of the linear oscillator; this gives the period for every amplitude beyond the gap. As for every
conservative system, a numerical method finds the family by asking for an amplitude with the damping
d as the unknown: d comes out as 0.

Source: elementary (uniform motion in the gap, half a sine on each spring). Assumptions: massless
springs without damping, no loss at the contact.

Symbols: x [m] displacement from the middle of the gap; m [kg] mass; d [N s/m] damping; k [N/m]
stiffness of each spring; delta [m] distance from the middle to each spring.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie import Coordinate, Element, Output, Parameter, System
from hbbogie.model import DeadBand


def gap_oscillator(**parameters: float) -> System:
    """Return the oscillator, one equation of second order.

    Parameters
    ----------
    **parameters : float
        Values of m [kg], d [N s/m], k [N/m], delta [m] that replace the defaults 1, 0, 1, 1.
    """
    x = Coordinate("x", "m", "displacement from the middle of the gap")
    m = Parameter("m", 1.0, "kg", "mass", (1e-9, 1e9))
    d = Parameter("d", 0.0, "N s/m", "damping", (-1e9, 1e9))
    k = Parameter("k", 1.0, "N/m", "stiffness of each spring", (1e-9, 1e15))
    delta = Parameter("delta", 1.0, "m", "distance from the middle to each spring", (0.0, 1e6))
    springs = Element("springs", DeadBand(stiffness=k, gap=delta), x)
    system = System(
        "gap oscillator",
        [x],
        [m, d, k, delta],
        [m * x.ddot + d * x.dot + springs],
        [springs],
        description="free mass between springs behind gaps",
        outputs=[
            Output("spring force", springs, "N", "of the spring that is touched"),
            Output("acceleration", x.ddot, "m/s2", "of the mass"),
        ],
    )
    return system.with_parameters(**parameters)


def period(amplitude: ArrayLike, m: float = 1.0, k: float = 1.0, delta: float = 1.0) -> NDArray[np.float64]:
    """Return the period 2 pi sqrt(m/k) + 4 sqrt(m/k) delta / (A - delta) of the undamped motion.

    Parameters
    ----------
    amplitude : array_like, m
        Peak displacement A.
    m : float, kg
    k : float, N/m
    delta : float, m

    Returns
    -------
    ndarray, shape of amplitude, s
        NaN where the amplitude does not reach the springs: there is no periodic motion.
    """
    A = np.asarray(amplitude, dtype=float)
    depth = A - delta
    depth = np.where(depth > 0, depth, np.nan)
    return np.sqrt(m / k) * (2 * np.pi + 4 * delta / depth)


def velocity_in_gap(amplitude: ArrayLike, m: float = 1.0, k: float = 1.0, delta: float = 1.0) -> NDArray[np.float64]:
    """Return the speed sqrt(k/m) (A - delta) with which the undamped mass crosses the gap.

    Parameters
    ----------
    amplitude : array_like, m
        Peak displacement A, beyond delta.
    m : float, kg
    k : float, N/m
    delta : float, m

    Returns
    -------
    ndarray, shape of amplitude, m/s
    """
    return np.sqrt(k / m) * (np.asarray(amplitude, dtype=float) - delta)


SYSTEM = gap_oscillator
PARAMETER = "d"
RANGE = (-0.1, 0.1)
