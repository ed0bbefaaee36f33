"""How cycles begin at a Hopf point: sub- or supercritically."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hbbogie.branches.cycle_curve import VERTICAL
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.equilibria.normal_form import first_lyapunov
from hbbogie.model.system import System
from hbbogie.results import SpecialPoint
from hbbogie.solving.curve import Point


def onset(hopf: SpecialPoint, system: System, points: list[Point]) -> SpecialPoint:
    """Return a Hopf point with the verdict how cycles begin there.

    By the first Lyapunov coefficient; where there is none, as for a system that is linear until a gap closes, by the
    direction in which the parameter goes along the branch.

    Parameters
    ----------
    hopf : SpecialPoint
    system : System
    points : list of Point
        Of the branch that begins there.
    """
    coefficient = first_lyapunov(system, hopf)
    if np.isfinite(coefficient) and coefficient != 0:
        below = coefficient > 0
        why = f"first Lyapunov coefficient {coefficient:.4g}"
    else:
        first, second = float(points[0].u[-1]), float(points[min(1, len(points) - 1)].u[-1])
        if abs(second - first) <= VERTICAL * max(1.0, abs(first)):
            return hopf
        below = (second > first) != _gains(system, hopf)
        why = f"{hopf.parameter} {'rises' if second > first else 'falls'} along the branch where it begins"
    criticality = "subcritical" if below else "supercritical"
    return replace(hopf, criticality=criticality, status=f"{criticality}, {why}; {hopf.status}")


def _gains(system: System, hopf: SpecialPoint) -> bool:
    """Tell whether the equilibrium loses its stability as the parameter grows."""
    line, step = Linearisation(system, hopf.parameter), 1e-6 * max(abs(hopf.value), 1e-3)
    growths = []
    for value in (hopf.value - step, hopf.value + step):
        _, eigenvalues, _ = line.pairs(value)
        growths.append(eigenvalues[np.argmin(np.abs(eigenvalues - 1j * hopf.omega))].real)
    return bool(growths[1] > growths[0])
