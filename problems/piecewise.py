"""A planar system whose vector field jumps on a line: a cycle through two different flows.

In polar coordinates, on either side of the line x = 0,

    x < 0:  r' = r (1 - r),             theta' = 1
    x > 0:  r' = alpha r (beta - r),    theta' = gamma - r

On the left motions tend to the circle r = 1, on the right to r = beta, and a cycle that passes from one
to the other in turn is the compromise. The field jumps at x = 0, so that a small disturbance does as well:
the multipliers of the cycle contain the jump (saltation) matrices of both crossings.

Source: H. Dankowicz, F. Schilder, Recipes for Continuation, SIAM (2013), examples 9.2 and 10.3, and the
demonstrations of the continuation package COCO, where gamma + beta is written for what is gamma here. The
period and the multiplier of the table are results of COCO's collocation; an integration that stops at x = 0
gives the same digits. Assumptions: dimensionless, time in seconds.

Symbols: x, y [1] coordinates, x = r cos(theta), y = r sin(theta); r [1] radius; alpha [1/s] rate of
attraction on the right; beta [1] radius that attracts there; gamma [rad/s] speed of rotation there at r = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from hbbogie import Coordinate, Element, Parameter, System
from hbbogie.model import Step


def piecewise(**parameters: float) -> System:
    """Return the system, two equations of first order with one element that switches between the sides.

    Parameters
    ----------
    **parameters : float
        Values of alpha [1/s], beta [1], gamma [rad/s] that replace the defaults 1, 2, 3.5.
    """
    x = Coordinate("x", "1", "first coordinate, the field jumps at x = 0")
    y = Coordinate("y", "1", "second coordinate")
    alpha = Parameter("alpha", 1.0, "1/s", "rate of attraction on the right", (-1e3, 1e3))
    beta = Parameter("beta", 2.0, "1", "radius that attracts on the right", (-1e3, 1e3))
    gamma = Parameter("gamma", 3.5, "rad/s", "speed of rotation on the right at the origin", (-1e3, 1e3))
    s = x**2 + y**2
    r = ca.if_else(s > 0, ca.sqrt(ca.if_else(s > 0, s, 1)), 0)  # finite derivatives at the origin too
    right = Element("right", Step(), x)
    growth = (1 - right) * (1 - r) + right * alpha * (beta - r)
    rotation = (1 - right) + right * (gamma - r)
    equations = [x.dot - x * growth + y * rotation, y.dot - y * growth - x * rotation]
    system = System(
        "piecewise", [x, y], [alpha, beta, gamma], equations, [right], description="vector field that jumps on a line"
    )
    return system.with_parameters(**parameters)


SYSTEM = piecewise
PARAMETER = "beta"
RANGE = (1.2, 2.4)


@dataclass(frozen=True)
class Cycle:
    """The cycle at one set of parameters.

    Attributes
    ----------
    alpha, beta, gamma : float
        Parameters, in their units.
    period : float, s
    multiplier : float, dimensionless
        The nontrivial Floquet multiplier.
    """

    alpha: float
    beta: float
    gamma: float
    period: float
    multiplier: float


PUBLISHED = (Cycle(1.0, 2.0, 3.5, 4.810271605994, 0.00243051),)
