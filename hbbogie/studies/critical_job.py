"""The job "critical": the smallest critical value of a parameter, with gradients and with the evidence."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.continuation import trace
from hbbogie.critical import Critical, fold, hopf_gradient
from hbbogie.cycles import default_reach
from hbbogie.equations import Equations
from hbbogie.errors import ModelError, unknown_name
from hbbogie.guesses import hopf_points
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.studies.ladder import climb
from hbbogie.system import System

Outputs = dict[str, Any]
Array = NDArray[np.float64]
FAILURES = (RuntimeError, np.linalg.LinAlgError)  # ConvergenceError and CasADi's are among the first
SEARCHES = ("lowest", "all", "warm")
KNOWN = 200  # folds kept for warm starts
NEAR = 0.2  # relative distance of parameters, and of the frequency, up to which they serve
NARROW = (1e-5, 1e-7)  # widths to which folds are bracketed, tried in turn
PLAIN: dict[str, Any] = {"max_points": 200, "families": False, "stability": False}  # how branches are traced
MARGIN = 0.05  # by which a branch goes on beyond its Hopf point's value, as a share of the interval below
STEPS = (0.02, 0.05, 0.005)  # first steps of a continuation, tried in turn


def critical(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    harmonics: int = 15,
    gradients: bool = True,
    search: str = "lowest",
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

    Returns
    -------
    dict
        ``critical``, the smallest critical value, and its ``kind``; ``fold`` and ``hopf``, the smallest of each;
        ``depth``, how far ``critical`` lies below ``hopf`` [%]; ``fold_omega``, ``hopf_omega`` [rad/s];
        ``fold_<coordinate>``, the peak of each nonlinear coordinate at the fold; numbers of ``folds`` and ``hopfs``;
        and the gradients. "No fold" with the evidence is an answer; a branch that cannot be followed is not.
    """
    if search not in SEARCHES:
        raise ModelError(f"job critical: {unknown_name('search', search, SEARCHES)}")
    span = (float(interval[0]), float(interval[1])) if interval else default_reach(system, parameter)
    points = hopf_points(system, parameter, span)
    where = f"from {span[0]:g} to {span[1]:g}"
    if not points:
        return {
            "kind": "",
            "folds": 0,
            "hopfs": 0,
            "status": f"no Hopf point {where}, and no branch to look for a fold on",
        }
    equations = HarmonicBalance(harmonics).equations(system)
    hopf = hopf_gradient(system, points[0])
    if search == "all":
        followed = [_all(equations, point, span) for point in points]
    elif search == "warm" and len(points) == 1:
        followed = [_warm(equations, points[0], span)]
    else:
        followed = [_lowest(equations, point, span, hopf.value) for point in points]
    folds = [c for f in followed for c in f.folds]
    if search != "all":
        folds, where = [c for c in folds if c.value < hopf.value], f"from {span[0]:g} to the Hopf point"
    first = min(folds, key=lambda c: c.value, default=None)
    outputs: Outputs = {"kind": "hopf", "critical": hopf.value}
    if first is not None and first.value < hopf.value:
        outputs = {"kind": "fold", "critical": first.value}
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
    ends = [f"from the Hopf point at {h.value:.6g}: {f.end}" for h, f in zip(points, followed, strict=True)]
    status = "; ".join([text, *ends])
    return outputs | {"folds": len(folds), "hopfs": len(points), "status": status, "failed": failed}


def _point(kind: str, c: Critical, gradients: bool) -> Outputs:
    slopes = {f"d{kind}_d{name}": slope for name, slope in c.gradient.items()} if gradients else {}
    return {kind: c.value, f"{kind}_omega": c.omega, **slopes}


@dataclass(frozen=True, eq=False)
class _Followed:
    """The folds of a branch, the lowest value met, why it ended, and whether it was followed to its end."""

    folds: list[Critical]
    lowest: float
    end: str
    complete: bool


def _warm(equations: Equations, hopf: SpecialPoint, span: tuple[float, float]) -> _Followed:
    """Go to the fold from the nearest one known; where that leads elsewhere or is far, follow the branch."""
    system, name = equations.system, hopf.parameter
    p = np.delete(system.vector(), system.parameter_names.index(name))
    known: deque[tuple[Array, Orbit]] = equations.once(("known folds", name), lambda: deque(maxlen=KNOWN))

    def distance(entry: tuple[Array, Orbit]) -> float:
        return float(np.max(np.abs(p - entry[0]) / np.where(entry[0] == 0, 1.0, np.abs(entry[0])), initial=0.0))

    nearest = min(known, key=distance, default=None)
    if nearest is not None and distance(nearest) <= NEAR:
        try:
            c = fold(equations, nearest[1], name, search=False)
            one = c.extremum == "minimum" and span[0] <= c.value < hopf.value
            if one and abs(c.omega / hopf.omega - 1) <= NEAR:
                known.append((p, c.orbit))
                return _Followed([c], c.value, "reached from the fold of a neighbour", True)
        except FAILURES:
            pass
    found = _lowest(equations, hopf, span, hopf.value)
    known.extend((p, c.orbit) for c in found.folds if c.gradient)
    return found


def _lowest(equations: Equations, hopf: SpecialPoint, span: tuple[float, float], below: float) -> _Followed:
    """Follow a branch until it is back at its Hopf point's value; solve for the folds below a value."""
    lost = None
    for narrow in NARROW:
        try:
            ladder = climb(equations, hopf, span[0], below, narrow)
            if not ladder.complete:
                lost = _Followed([], ladder.lowest, ladder.end, False)
                break
            near = [orbit for orbit in ladder.folds if orbit.parameters[hopf.parameter] < below]
            found = [fold(equations, orbit, hopf.parameter, search=False) for orbit in near]
            return _Followed(found, ladder.lowest, ladder.end, True)
        except FAILURES:
            continue
    if lost is not None and below < min(hopf.value, lost.lowest):
        return lost  # a branch far above what is looked for is not worth the longer way, by arclength
    return _all(equations, hopf, (span[0], min(span[1], hopf.value + MARGIN * (hopf.value - span[0]))))


def _all(equations: Equations, hopf: SpecialPoint, span: tuple[float, float]) -> _Followed:
    """Follow a branch through an interval."""
    reason = ""
    for step in STEPS:
        try:
            branch = trace(equations, hopf, hopf.parameter, span, step=step, **PLAIN)
        except FAILURES as error:
            reason = reason or str(error).partition("\n")[0]
            continue
        end = branch.ends[1]
        stuck = end.startswith(("no further point", "the largest number"))
        folds = [_located(equations, s) for s in branch.folds()]
        return _Followed(folds, float(branch.values.min()), end.partition(";")[0], not stuck)
    return _Followed([], hopf.value, f"no branch was traced: {reason}", False)


def _located(equations: Equations, special: SpecialPoint) -> Critical:
    """Return a fold of a branch with its gradient; without one where the conditions of optimality are not met."""
    try:
        return fold(equations, special, special.parameter, search=False)
    except FAILURES:
        nan, name, orbit = float("nan"), special.parameter, special.orbit
        return Critical("fold", name, special.value, "", special.omega, {}, orbit, nan, nan, special.status)
