"""An isola: a closed branch of cycles that no Hopf point leads to, beside a branch that begins at one.

In polar coordinates the motion is r' = r g(r^2), theta' = w0 with

    g(s) = -((s - c)^2 + mu^2 - rho^2) (s - s0 - b mu)

so that the cycles are circles of radius sqrt(s): one branch s = s0 + b mu from the Hopf point at mu = -s0 / b, and the
isola (s - c)^2 + mu^2 = rho^2, which exists for |mu| <= rho only.

Source: M. Golubitsky, D. G. Schaeffer, Singularities and Groups in Bifurcation Theory I, Springer 1985, chapter II
(isola centre x^2 + lambda^2), here for the amplitude of a limit cycle.
Assumptions: cycles are circles run through at a constant frequency; x, y dimensionless, time in seconds.

Symbols: x, y [1] coordinates; mu [1] parameter; c [1] squared radius at the centre of the isola; rho [1] its size;
s0 [1], b [1] squared radius and slope of the other branch; w0 [rad/s] frequency.
"""

from __future__ import annotations

from hbbogie import Coordinate, Parameter, System


def isola(**parameters: float) -> System:
    """Return the system, two equations of first order.

    Parameters
    ----------
    **parameters : float
        Values of mu, c, rho, s0, b [1] and w0 [rad/s] that replace the defaults 0, 2, 0.5, 0.3, 0.1 and 1.
    """
    x = Coordinate("x", "1", "first coordinate")
    y = Coordinate("y", "1", "second coordinate")
    mu = Parameter("mu", 0.0, "1", "parameter", (-1e3, 1e3))
    c = Parameter("c", 2.0, "1", "squared radius at the centre of the isola", (0.0, 1e3))
    rho = Parameter("rho", 0.5, "1", "size of the isola", (0.0, 1e3))
    s0 = Parameter("s0", 0.3, "1", "squared radius of the other branch", (-1e3, 1e3))
    b = Parameter("b", 0.1, "1", "slope of the other branch", (-1e3, 1e3))
    w0 = Parameter("w0", 1.0, "rad/s", "frequency", (1e-6, 1e6))
    s = x**2 + y**2
    rate = -((s - c) ** 2 + mu**2 - rho**2) * (s - s0 - b * mu)
    equations = [x.dot - x * rate + w0 * y, y.dot - y * rate - w0 * x]
    system = System("isola", [x, y], [mu, c, rho, s0, b, w0], equations, description="a closed branch of cycles")
    return system.with_parameters(**parameters)


SYSTEM = isola
PARAMETER = "mu"
RANGE = (-4.0, 4.0)
