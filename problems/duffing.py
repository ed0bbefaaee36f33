"""Free Duffing oscillator: a spring with a cubic term, without excitation.

    x'' + d x' + alpha x + beta x^3 = 0

Without damping every amplitude belongs to one periodic motion; the curve of frequency over
amplitude, the backbone, is known in closed form. A numerical method finds this family by asking for
an amplitude with the damping d as the unknown: d comes out as 0.

Source: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations (1979), chapter 2; period by the complete
elliptic integral of the first kind. Assumptions: unit mass; damping linear.

Symbols: x [m] displacement; d [1/s] damping; alpha [1/s2] linear stiffness; beta [1/(m2 s2)] cubic
stiffness, all divided by the mass.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ellipk

from hbbogie import Coordinate, Element, Output, Parameter, System
from hbbogie.model import Cubic


def duffing(**parameters: float) -> System:
    """Return the oscillator, one equation of second order.

    Parameters
    ----------
    **parameters : float
        Values of d [1/s], alpha [1/s2], beta [1/(m2 s2)] that replace the defaults 0, 1, 1.
    """
    x = Coordinate("x", "m", "displacement")
    d = Parameter("d", 0.0, "1/s", "damping over mass", (-1e3, 1e3))
    alpha = Parameter("alpha", 1.0, "1/s2", "linear stiffness over mass", (-1e9, 1e9))
    beta = Parameter("beta", 1.0, "1/(m2 s2)", "cubic stiffness over mass", (-1e12, 1e12))
    spring = Element("spring", Cubic(coefficient=beta, stiffness=alpha), x)
    system = System(
        "Duffing oscillator",
        [x],
        [d, alpha, beta],
        [x.ddot + d * x.dot + spring],
        [spring],
        description="free oscillator with a cubic spring",
        outputs=[
            Output("spring force", spring, "m/s2", "over the mass"),
            Output("energy", x.dot**2 / 2 + alpha * x**2 / 2 + beta * x**4 / 4, "m2/s2", "over the mass"),
        ],
    )
    return system.with_parameters(**parameters)


def backbone(amplitude: ArrayLike, alpha: float = 1.0, beta: float = 1.0) -> NDArray[np.float64]:
    """Return the frequency of the undamped motion about x = 0 with an amplitude.

    With k = alpha + beta A^2 and m = beta A^2 / (2 k): omega = pi sqrt(k) / (2 K(m)).

    Parameters
    ----------
    amplitude : array_like, m
        Peak displacement A.
    alpha : float, 1/s2
    beta : float, 1/(m2 s2)

    Returns
    -------
    ndarray, shape of amplitude, rad/s
        NaN where there is no periodic motion through x = 0 with this amplitude.
    """
    cubic = beta * np.asarray(amplitude, dtype=float) ** 2
    # the motion must cross x = 0 (potential higher at A than at 0) and turn back at A (force inwards there)
    exists = (alpha + cubic > 0) & (alpha + cubic / 2 > 0)
    k = np.where(exists, alpha + cubic, np.nan)
    return np.pi * np.sqrt(k) / (2 * ellipk(cubic / (2 * k)))


def energy(amplitude: ArrayLike, alpha: float = 1.0, beta: float = 1.0) -> NDArray[np.float64]:
    """Return the energy alpha A^2 / 2 + beta A^4 / 4 per unit mass of the undamped motion.

    Parameters
    ----------
    amplitude : array_like, m
        Peak displacement A.
    alpha : float, 1/s2
    beta : float, 1/(m2 s2)

    Returns
    -------
    ndarray, shape of amplitude, m2/s2
    """
    s = np.asarray(amplitude, dtype=float) ** 2
    return alpha * s / 2 + beta * s**2 / 4


SYSTEM = duffing
PARAMETER = "d"
RANGE = (-0.1, 0.1)
