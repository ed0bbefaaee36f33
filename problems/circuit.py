"""An electronic circuit with a cubic element: folds, pitchforks, period doublings and a torus on one branch.

A capacitor with a nonlinear conductance is coupled through another nonlinear conductance to a resonant circuit:

    x' = (-(b + v) x + b y - a3 x^3 + b3 (y - x)^3) / r
    y' = b x - (b + g) y - z - b3 (y - x)^3
    z' = y + e

With e = 0 the equations are odd and symmetric cycles lose their symmetry at a pitchfork; a small e breaks it up.

Source: E. Freire, A. J. Rodriguez-Luis, E. Gamero, E. Ponce, A case study for homoclinic chaos in an autonomous
electronic circuit, Physica D 62 (1993) 230-253. The numbers below are those of the continuation packages that use it as
their example of a torus bifurcation (AUTO-07p "tor", MATCONT "torBPC").
Assumptions: all quantities dimensionless, cubic conductances.

Symbols: x, y [1] voltages; z [1] current; v [1] conductance that is varied; b, g [1] linear conductances; r [1] ratio
of the capacitances; a3, b3 [1] cubic conductances; e [1] bias that breaks the symmetry.
"""

from __future__ import annotations

from dataclasses import dataclass

from hbbogie import Coordinate, Parameter, System


def circuit(**parameters: float) -> System:
    """Return the circuit, three equations of first order.

    Parameters
    ----------
    **parameters : float
        Values of v, b, g, r, a3, b3, e, all dimensionless, that replace the defaults of `BIASED`.
    """
    x = Coordinate("x", "1", "first voltage")
    y = Coordinate("y", "1", "second voltage")
    z = Coordinate("z", "1", "current")
    v = Parameter("v", -0.59, "1", "conductance")
    b = Parameter("b", 0.5, "1", "coupling conductance")
    g = Parameter("g", -0.6, "1", "conductance of the resonant circuit")
    r = Parameter("r", 0.6, "1", "ratio of the capacitances", (1e-6, 1e6))
    a3 = Parameter("a3", 0.32858, "1", "cubic conductance")
    b3 = Parameter("b3", 0.93358, "1", "cubic coupling conductance")
    e = Parameter("e", 0.001, "1", "bias")
    equations = [
        r * x.dot + (b + v) * x - b * y + a3 * x**3 - b3 * (y - x) ** 3,
        y.dot - b * x + (b + g) * y + z + b3 * (y - x) ** 3,
        z.dot - y - e,
    ]
    system = System("circuit", [x, y, z], [v, b, g, r, a3, b3, e], equations, description="torus and symmetry breaking")
    return system.with_parameters(**parameters)


@dataclass(frozen=True)
class Published:
    """A special point as printed: kind, value of v and period T, None where it is not printed."""

    kind: str
    v: float
    T: float | None


# six digits are printed
BIASED = {"e": 0.001, "a3": 0.32858, "b3": 0.93358}
BIASED_POINTS = (
    Published("fold", -0.584493, 8.41186),
    Published("Neimark-Sacker", -0.595750, 8.86110),
    Published("period doubling", -0.614682, 9.25685),
)
SYMMETRIC = {"e": 0.0, "a3": 0.328578, "b3": 0.933578}
SYMMETRIC_POINTS = (
    Published("hopf", -0.589336478, None),
    Published("fold", -0.584335, 8.42647),
    Published("pitchfork", -0.587028974, 8.68966962),
)

SYSTEM = circuit
PARAMETER = "v"
RANGE = (-0.65, -0.57)
