"""Van der Pol's oscillator: the standard example of a self-excited oscillation.

    x'' - mu (1 - x^2) x' + x = 0

Small motions grow and large ones decay for mu > 0: a stable limit cycle for every mu > 0, nearly
harmonic with amplitude 2 for small mu, a relaxation oscillation for large mu. At mu = 0 the motion is
that of a linear oscillator; for mu < 0 the cycle is unstable (time reversed).

Source: B. van der Pol, On relaxation oscillations, Philosophical Magazine 2 (1926) 978-992. The period
and the peak for mu = 1 are those of E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential
Equations I (1993), an example computed to 26 digits; all numbers of the table were recomputed by a
Taylor series of order 45 with 45 digits, to which the values here are rounded. Assumptions: everything
is dimensionless, with the frequency of the undamped linear oscillator as the unit, 1 rad/s.

Symbols: x [1] coordinate; y [1] its rate, in the form of first order; mu [1] negative damping at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

from hbbogie import Coordinate, Output, Parameter, System


def van_der_pol(**parameters: float) -> System:
    """Return the oscillator as one equation of second order.

    Parameters
    ----------
    **parameters : float
        Value of mu that replaces the default 1.
    """
    x = Coordinate("x", "1", "displacement")
    mu = _mu()
    equations = [x.ddot - mu * (1 - x**2) * x.dot + x]
    outputs = [
        Output("energy", (x.dot**2 + x**2) / 2, "1", "of motion and spring"),
        Output("power of the self-excitation", mu * x.dot**2, "1/s", "fed in by the negative damping"),
        Output("dissipated power", mu * x**2 * x.dot**2, "1/s", "taken out by the nonlinear damping"),
    ]
    system = System("van der Pol", [x], [mu], equations, description="self-excited oscillation", outputs=outputs)
    return system.with_parameters(**parameters)


def van_der_pol_first_order(**parameters: float) -> System:
    """Return the oscillator as two equations of first order, with y the rate of x.

    Parameters
    ----------
    **parameters : float
        Value of mu that replaces the default 1.
    """
    x, y = Coordinate("x", "1", "displacement"), Coordinate("y", "1", "rate of x")
    mu = _mu()
    equations = [x.dot - y, y.dot - mu * (1 - x**2) * y + x]
    system = System("van der Pol, first order", [x, y], [mu], equations, description="self-excited oscillation")
    return system.with_parameters(**parameters)


def _mu() -> Parameter:
    return Parameter("mu", 1.0, "1", "negative damping at rest", (-1e4, 1e4))


SYSTEM = van_der_pol
PARAMETER = "mu"
RANGE = (-0.5, 3.0)


@dataclass(frozen=True)
class Cycle:
    """The limit cycle at one value of mu.

    Attributes
    ----------
    mu : float, dimensionless
    period : float, s
    peak : float, dimensionless
        Largest x over the period.
    multiplier : float, dimensionless
        The nontrivial Floquet multiplier.
    """

    mu: float
    period: float
    peak: float
    multiplier: float


PUBLISHED = (
    Cycle(1.0, 6.66328685932313019, 2.00861986087484314, 8.59695063603805e-4),
    Cycle(5.0, 11.6122306677195700, 2.02150806156232132, 7.73855508685936e-38),
    Cycle(10.0, 19.0783695669390141, 2.01428536092640529, 3.69637777705290e-136),
)
