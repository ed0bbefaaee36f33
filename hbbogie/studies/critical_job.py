"""The job "critical": the smallest critical value of a parameter, with gradients and with the evidence."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.resolution import doubt_at_fold
from hbbogie.critical.folds import Critical
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.critical.lowest import all_folds, lowest_fold, warm_fold
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, unknown_name
from hbbogie.exact.critical import nominal_design
from hbbogie.exact.starting import cycle_of
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Outputs = dict[str, Any]
SEARCHES = ("lowest", "all", "warm")
METHODS = ("mhb", "exact")


def smallest_critical(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    harmonics: int = 15,
    gradients: bool = True,
    search: str = "lowest",
    method: str = "mhb",
) -> Outputs:
    """Find the critical values of a parameter, with their gradients.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
        Where to look.
    harmonics : int
        Highest harmonic.
    gradients : bool
        Whether the outputs hold ``dfold_d<name>`` and ``dhopf_d<name>`` for every parameter.
    search : {"lowest", "all", "warm"}
        "lowest" follows each branch from its Hopf point until it is back at the value there, "all" through the
        whole interval, as `hbbogie.critical_speeds` does, which takes three times as long. Below the first Hopf
        point, where the smallest critical value lies, both find the same folds; "lowest" keeps no others. "warm" begins
        at the fold of the nearest point done before, if that is near, and takes half the time where few parameters
        vary; it does not look for a second fold.
    method : {"mhb", "exact"}
        "mhb" is harmonic balance. "exact" takes cycles in closed form, for systems that are linear between switchings:
        the first Hopf point and the fold below it of the branch that begins there, from the fold of the parameters'
        own values where that leads there. It has no use for ``harmonics`` and ``search``, and does not count ``hopfs``.

    Returns
    -------
    dict
        ``critical``, the smallest critical value, and its ``kind``; ``fold`` and ``hopf``, the smallest of each;
        ``depth``, how far ``critical`` lies below ``hopf`` [%]; ``fold_omega``, ``hopf_omega`` [rad/s];
        ``fold_<coordinate>``, the peak of each nonlinear coordinate at the fold; numbers of ``folds`` and ``hopfs``;
        the gradients; and ``evidence``, what was searched for Hopf points. "No fold" is an answer; a branch that cannot
        be followed is not.
    """
    if search not in SEARCHES:
        raise ModelError(f"job critical: {unknown_name('search', search, SEARCHES)}")
    if method not in METHODS:
        raise ModelError(f"job critical: {unknown_name('method', method, METHODS)}")
    span = (float(interval[0]), float(interval[1])) if interval else default_reach(system, parameter)
    if method == "exact":
        return _exact(system, parameter, span, gradients)
    points = hopf_points(system, parameter, span)
    where = f"from {span[0]:g} to {span[1]:g}"
    if not points:
        return {
            "kind": "",
            "folds": 0,
            "hopfs": 0,
            "evidence": "; ".join(points.evidence),
            "status": f"no Hopf point {where}, and no branch to look for a fold on",
        }
    equations = HarmonicBalance(harmonics).equations(system)
    hopf = hopf_gradient(system, points[0])
    if search == "all":
        followed = [all_folds(equations, h, span) for h in points]
    elif search == "warm" and len(points) == 1:
        followed = [warm_fold(equations, points[0], span)]
    else:
        followed = [lowest_fold(equations, h, span, hopf.value) for h in points]
    folds = [c for f in followed for c in f.folds]
    if search != "all":
        folds, where = [c for c in folds if c.value < hopf.value], f"from {span[0]:g} to the Hopf point"
    first = min(folds, key=lambda c: c.value, default=None)
    outputs: Outputs = {"kind": "hopf", "critical": hopf.value, "evidence": "; ".join(points.evidence)}
    if first is not None and first.value < hopf.value:
        outputs |= {"kind": "fold", "critical": first.value}
    # a branch that got lost above the smallest critical value may still come down, but was not seen to
    failed = any(not f.complete and (f is followed[0] or f.lowest < outputs["critical"]) for f in followed)
    if hopf.value:
        outputs["depth"] = 100 * (1 - outputs["critical"] / hopf.value)
    outputs |= _point("hopf", hopf, gradients)
    if first is not None:
        outputs |= _point("fold", first, gradients)
        outputs |= {f"fold_{c}": first.orbit.amplitude(c) for c in system.nonlinear_coordinates}
    text = f"fold at {first.value:.6g}" if first is not None else f"no fold {where}"
    if first is not None and not first.gradient:
        text += ", without gradient"
    if first is not None and (doubt := doubt_at_fold(system, first.orbit)):
        text += f", {doubt}"
    ends = [f"from the Hopf point at {h.value:.6g}: {f.end}" for h, f in zip(points, followed, strict=True)]
    status = "; ".join([text, *ends])
    return outputs | {"folds": len(folds), "hopfs": len(points), "status": status, "failed": failed}


def _point(kind: str, c: Critical, gradients: bool) -> Outputs:
    return _values(kind, c.value, c.omega, c.gradient if gradients else {})


def _values(kind: str, value: float, omega: float, gradient: dict[str, float]) -> Outputs:
    return {kind: value, f"{kind}_omega": omega} | {f"d{kind}_d{name}": slope for name, slope in gradient.items()}


def _exact(system: System, parameter: str, span: tuple[float, float], gradients: bool) -> Outputs:
    """Return the outputs of the job from cycles in closed form."""
    own = system.with_parameters(**{p.name: p.default for p in system.parameters})
    try:
        nominal = system.once(("nominal design", parameter, span), lambda: nominal_design(own, parameter, span))
    except ConvergenceError:  # the point is its own beginning
        if not hopf_points(system, parameter, span):
            return {"kind": "", "folds": 0, "status": f"no Hopf point from {span[0]:g} to {span[1]:g}"}
        nominal = nominal_design(system, parameter, span)
    found = nominal.critical_values(system.vector()[None])
    fold, hopf, status = found.folds[0], found.hopf, found.status[0]
    value, outputs = float(hopf.value[0]), Outputs()

    def named(gradient: NDArray[np.float64]) -> dict[str, float]:
        by_name = zip(system.parameter_names, map(float, gradient), strict=True)
        return {name: slope for name, slope in by_name if name != parameter} if gradients else {}

    if np.isnan(value):
        return {"kind": "", "folds": 0, "status": status, "failed": bool(found.failed[0])}
    if not found.failed[0]:
        outputs = {
            "kind": "fold" if fold else "hopf",
            "critical": fold.value if fold else value,
            "folds": int(bool(fold)),
        }
        outputs["depth"] = 100 * (1 - outputs["critical"] / value) if value else None
    outputs |= _values("hopf", value, float(hopf.omega[0]), named(hopf.gradient[0]))
    if fold is not None:
        low, high = (np.abs(side) for side in cycle_of(fold).extremes())
        peaks = dict(zip(system.coordinate_names, map(float, np.maximum(low, high)), strict=True))
        outputs |= _values("fold", fold.value, fold.omega, named(fold.gradient))
        outputs |= {f"fold_{c}": peaks[c] for c in system.nonlinear_coordinates}
        status = f"fold at {fold.value:.6g}; {status}"
    return outputs | {"status": status, "failed": bool(found.failed[0])}
