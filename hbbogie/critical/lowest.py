"""The lowest fold of a branch, found from its Hopf point or from known folds near by."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.continuation import trace
from hbbogie.critical.folds import fold
from hbbogie.critical.ladder import climb
from hbbogie.methods.equations import Equations
from hbbogie.results.branch import SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.results.orbit import Orbit

Array = NDArray[np.float64]

KNOWN = 200  # folds kept for warm starts
NEAR = 0.2  # relative distance of parameters, and of the frequency, up to which they serve
NARROW = (1e-5, 1e-7)  # widths to which folds are bracketed, tried in turn
PLAIN: dict[str, Any] = {"max_points": 200, "families": False, "stability": False}  # how branches are traced
MARGIN = 0.05  # by which a branch goes on beyond its Hopf point's value, as a share of the interval below
STEPS = (0.02, 0.05, 0.005)  # first steps of a continuation, tried in turn


@dataclass(frozen=True, eq=False)
class _BranchFolds:
    """The folds of a branch, the lowest value met, why it ended, and whether it was followed to its end."""

    folds: list[Critical]
    lowest: float
    end: str
    complete: bool


def warm_fold(equations: Equations, hopf: SpecialPoint, span: tuple[float, float]) -> _BranchFolds:
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
                return _BranchFolds([c], c.value, "reached from the fold of a neighbour", True)
        except FAILURES:
            pass
    found = lowest_fold(equations, hopf, span, hopf.value)
    known.extend((p, c.orbit) for c in found.folds if c.gradient)
    return found


def lowest_fold(equations: Equations, hopf: SpecialPoint, span: tuple[float, float], below: float) -> _BranchFolds:
    """Follow a branch until it is back at its Hopf point's value; solve for the folds below a value."""
    lost = None
    for narrow in NARROW:
        try:
            ladder = climb(equations, hopf, span[0], below, narrow)
            if not ladder.complete:
                lost = _BranchFolds([], ladder.lowest, ladder.end, False)
                break
            near = [orbit for orbit in ladder.folds if orbit.parameters[hopf.parameter] < below]
            found = [fold(equations, orbit, hopf.parameter, search=False) for orbit in near]
            return _BranchFolds(found, ladder.lowest, ladder.end, True)
        except FAILURES:
            continue
    if lost is not None and below < min(hopf.value, lost.lowest):
        return lost  # a branch far above what is looked for is not worth the longer way, by arclength
    return all_folds(equations, hopf, (span[0], min(span[1], hopf.value + MARGIN * (hopf.value - span[0]))))


def all_folds(equations: Equations, hopf: SpecialPoint, span: tuple[float, float]) -> _BranchFolds:
    """Follow a branch through an interval."""
    reason = ""
    for step in STEPS:
        try:
            branch = trace(equations, hopf, hopf.parameter, span, step=step, **PLAIN)
        except FAILURES as error:
            reason = reason or str(error).partition("\n")[0]
            continue
        end = branch.ends[1]
        folds = [_located(equations, s) for s in branch.folds()]
        return _BranchFolds(folds, float(branch.values.min()), end.what, end.kind not in ("stuck", "points"))
    return _BranchFolds([], hopf.value, f"no branch was traced: {reason}", False)


def _located(equations: Equations, special: SpecialPoint) -> Critical:
    """Return a fold of a branch with its gradient; without one where the conditions of optimality are not met."""
    try:
        return fold(equations, special, special.parameter, search=False)
    except FAILURES:
        nan, name, orbit = float("nan"), special.parameter, special.orbit
        return Critical(
            kind="fold",
            parameter=name,
            value=special.value,
            extremum="",
            omega=special.omega,
            gradient={},
            orbit=orbit,
            residual=nan,
            curvature=nan,
            status=special.status,
        )
