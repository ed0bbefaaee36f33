"""The interval around the fold and the Hopf point that jobs examine."""

from __future__ import annotations

from types import ModuleType

from hbbogie.attraction.basin import HARMONICS
from hbbogie.branches.diagram import Diagram, bifurcation_diagram
from hbbogie.model.problem import default_interval
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.progress import Progress

LEAST = 0.01  # their distance counts at least so much, relative to the value


def _about(
    module: ModuleType,
    system: System,
    parameter: str | None,
    interval: tuple[float, float] | None,
    reach: tuple[float, float],
    progress: Progress,
) -> tuple[str, Diagram, tuple[float, float]]:
    """Return the parameter, the curves of cycles over it, and the range: as given, else about fold and Hopf point."""
    parameter, own = default_interval(module, system, parameter)
    if interval is not None:
        lo, hi = check_interval(system, parameter, interval)
        own = min(own[0], lo), max(own[1], hi)
    found = bifurcation_diagram(system, parameter, own, harmonics=HARMONICS, progress=progress)
    if interval is not None:
        return parameter, found, (lo, hi)
    lo, hi = own
    folds = [s.value for b in found.branches.values() for s in b.folds()]
    hopf = [s.value for s in found.hopf]
    for at in sorted(hopf):  # the first Hopf point with a fold below it, and the nearest fold
        below = [fold for fold in folds if fold < at]
        if below:
            width = max(at - max(below), LEAST * abs(at))
            return parameter, found, (max(lo, max(below) - reach[0] * width), min(hi, at + reach[1] * width))
    return parameter, found, (lo, hi)
