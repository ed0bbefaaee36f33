"""The onset of cycles at a Hopf point: sub- or supercritical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hbbogie.branches.cycle_curve import VERTICAL
from hbbogie.equilibria.eigenvalues import Eigenvalues
from hbbogie.equilibria.normal_form import first_lyapunov
from hbbogie.model.system import System
from hbbogie.results import SpecialPoint
from hbbogie.results.failure import ConvergenceError


def onset(hopf: SpecialPoint, system: System, values: Sequence[float]) -> SpecialPoint:
    """Return a Hopf point with the verdict how cycles begin there.

    By the first Lyapunov coefficient; where there is none, as for a system that is linear until a gap closes, by the
    direction in which the parameter goes along the branch.

    Parameters
    ----------
    hopf : SpecialPoint
    system : System
        At the value of the Hopf point.
    values : sequence of float, unit of the parameter
        At the first points of the branch that begins there.
    """
    coefficient = first_lyapunov(system, hopf)
    if np.isfinite(coefficient) and coefficient != 0:
        below = coefficient > 0
        why = f"first Lyapunov coefficient {coefficient:.4g}"
    else:
        first, second = values[0], values[min(1, len(values) - 1)]
        slope = _growth(system, hopf)
        if abs(second - first) <= VERTICAL * max(1.0, abs(first)) or not slope:
            return hopf
        below = (second > first) != (slope > 0)
        why = f"{hopf.parameter} {'rises' if second > first else 'falls'} along the branch where it begins"
    criticality = "subcritical" if below else "supercritical"
    return replace(hopf, criticality=criticality, status=f"{criticality}, {why}; {hopf.status}")


def _growth(system: System, hopf: SpecialPoint) -> float:
    """Return the derivative of the real part of the critical eigenvalue in the parameter; 0 where there is none."""
    try:
        found = Eigenvalues(system, hopf.orbit.coefficients[0], system.vector())
    except (ConvergenceError, np.linalg.LinAlgError):
        return 0.0
    critical = int(np.argmin(np.abs(found.values - 1j * hopf.omega)))
    return float(found.slopes[critical, system.parameter_names.index(hopf.parameter)].real)
