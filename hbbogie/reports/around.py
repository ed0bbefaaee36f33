"""The interval around the fold and the Hopf point that jobs examine."""

from __future__ import annotations

from types import ModuleType

from hbbogie.attraction.basin import HARMONICS
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import from_hopf
from hbbogie.branches.diagram import Diagram, bifurcation_diagram
from hbbogie.critical.groups import cycles_of_groups
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.problem import default_interval
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.progress import Progress
from hbbogie.results import Branch
from hbbogie.results.failure import FAILURES

COARSE = 9  # highest harmonic with which the branches of many bodies are followed
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
    if len(system.groups) > 1:
        found = _of_groups(system, parameter, own, progress)
    else:
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


def _of_groups(system: System, parameter: str, interval: tuple[float, float], progress: Progress) -> Diagram:
    """Return the branches from Hopf points, and those of cycles in which one group of bodies moves alone.

    Cycles of a vehicle take many unknowns: they are not judged along the branches, only where motions are followed.
    """
    progress("looking for Hopf points", None)
    hopf, notes, branches = hopf_points(system, parameter, interval), list[str](), list[Branch]()
    equations = HarmonicBalance(COARSE).equations(system)
    for k, point in enumerate(hopf):
        progress(f"branches: that of the Hopf point at {parameter} = {point.value:.5g}", k / (len(hopf) + 1))
        try:
            branches += from_hopf(equations, point, parameter, interval)
        except FAILURES as error:
            notes.append(f"The branch of the Hopf point at {parameter} = {point.value:g} was not followed: {error}")
    if branches:
        progress("branches: cycles in which one group of bodies moves", len(hopf) / (len(hopf) + 1))
        for said, cycle in cycles_of_groups(equations, branches, [point.value for point in hopf]):
            notes.append(f"{said[0].upper()}{said[1:]}.")
            if cycle is None:
                continue
            try:
                branches.append(trace(equations, cycle, parameter, interval, families=False, stability=False))
            except FAILURES as error:
                notes.append(f"Its branch was not followed: {error}")
    named = {f"branch_{k + 1}": branch for k, branch in enumerate(branches)}
    notes.append("Branches that begin on these branches were not looked for: motions on their cycles are undecided.")
    return Diagram(parameter, interval, hopf, named, {}, [], tuple(notes))
