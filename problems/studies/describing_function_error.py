"""The job of the study describing_function_error: one bogie by one harmonic and by fifteen.

A harmonic balance with one harmonic is the describing function of first order. Compared are the fold, which
is the nonlinear critical speed, and the large cycle, the hunting motion, at a speed above the Hopf point.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hbbogie import ConvergenceError, HarmonicBalance, Orbit, System, hopf_points, trace
from hbbogie.branches import crossings
from hbbogie.results import SpecialPoint
from hbbogie.studies import smallest_critical

MANY = 15  # highest harmonic of what is taken as the truth
ABOVE = 1.1  # speed of the comparison, in units of that of the Hopf point


def errors(system: System, interval: tuple[float, float], parameter: str = "V") -> dict[str, Any]:
    """Compare one harmonic with fifteen.

    Parameters
    ----------
    system : System
    interval : (float, float), unit of the parameter
        Where to look for Hopf points and folds.
    parameter : str

    Returns
    -------
    dict
        ``hopf``; ``fold`` by fifteen harmonics and ``fold_one`` by one, and ``fold_error`` [%]; ``depth`` [%], how
        far the fold lies below the Hopf point; ``omega_error`` and ``peak_<coordinate>_error`` [%] of the large cycle.
    """
    one, many = (smallest_critical(system, parameter, interval, H, gradients=False) for H in (1, MANY))
    if "hopf" not in many:
        return {"status": many["status"]}
    hopf = hopf_points(system, parameter, interval)[0]
    found: dict[str, Any] = {"hopf": hopf.value, "failed": many["failed"]}  # one harmonic resolves nothing
    if "fold" in many:
        found |= {"fold": many["fold"], "depth": 100 * (1 - many["fold"] / hopf.value)}
    if "fold" in one:
        found["fold_one"] = one["fold"]
    if "fold" in one and "fold" in many:
        found["fold_error"] = 100 * (one["fold"] / many["fold"] - 1)
    rough, exact = (_large(system, H, hopf, interval[0]) for H in (1, MANY))
    if rough is None or exact is None:
        return found | {"status": "no large cycle above the Hopf point by one of the two"}
    found["omega_error"] = 100 * (rough.omega / exact.omega - 1)
    for name in system.nonlinear_coordinates:
        found[f"peak_{name}_error"] = 100 * (rough.amplitude(name) / exact.amplitude(name) - 1)
    return found | {"status": "compared"}


errors.units = {  # type: ignore[attr-defined]
    **dict.fromkeys(("hopf", "fold", "fold_one"), "m/s"),
    **dict.fromkeys(("fold_error", "depth", "omega_error", "peak_q1_error", "peak_q3_error"), "%"),
}


def _large(system: System, harmonics: int, hopf: SpecialPoint, low: float) -> Orbit | None:
    """Return the largest cycle of the branch from the Hopf point at the speed of the comparison."""
    equations, speed = HarmonicBalance(harmonics).equations(system), ABOVE * hopf.value
    for step in (0.02, 0.05):  # a continuation may meet a singular point with one step and not with another
        try:
            branch = trace(equations, hopf, hopf.parameter, (low, 1.01 * speed), step=step, families=False)
            orbits = crossings(equations, branch, speed)
            return max(orbits, key=lambda o: float(np.linalg.norm(o.coefficients[1:])), default=None)
        except np.linalg.LinAlgError:
            continue
    raise ConvergenceError(f"the branch with {harmonics} harmonics cannot be followed: a singular point")
