"""All curves of cycles over an interval of a parameter: branches, and families of conservative systems."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from hbbogie.continuation import trace
from hbbogie.cycles import crossings, default_reach, distinct, find_cycles, settled_cycles
from hbbogie.equations import Equations
from hbbogie.errors import ModelError
from hbbogie.guesses import check_interval, hopf_points
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.results import Branch, Orbit, SpecialPoint, Stability
from hbbogie.solvers import solve
from hbbogie.stability import floquet
from hbbogie.system import System

Progress = Callable[[str, float | None], None]
MAX_POINTS = 600  # of a branch; the family of a conservative system has no end
MOST_HARMONICS = 63  # with which a cycle is judged when fewer do not suffice
RESOLVED = 1e-3  # tail of the spectrum up to which a cycle of a family is shown
LARGEST = 10.0  # peak up to which a family is shown, in units of the amplitude scale
FAILURES = (ModelError, RuntimeError, np.linalg.LinAlgError)  # ConvergenceError and CasADi's among the second


def silent(message: str, fraction: float | None) -> None:
    """Take a message on progress and show nothing."""


@dataclass(frozen=True, eq=False)
class Curves:
    """What exists over an interval of a parameter.

    Attributes
    ----------
    parameter : str
    interval : (float, float), unit of the parameter
    hopf : list of SpecialPoint
    branches : dict of Branch
        By name.
    families : dict of Branch
        Cycles of every amplitude at one value of the parameter, by name.
    cycles : list of Orbit
        The cycles at the system's parameter values.
    notes : tuple of str
        What could not be computed and why.
    """

    parameter: str
    interval: tuple[float, float]
    hopf: list[SpecialPoint]
    branches: dict[str, Branch]
    families: dict[str, Branch]
    cycles: list[Orbit]
    notes: tuple[str, ...]


def default_interval(
    module: ModuleType, system: System, parameter: str | None = None
) -> tuple[str, tuple[float, float]]:
    """Return the parameter to follow and where: the module's PARAMETER and RANGE, where they apply.

    Otherwise the system's first parameter, and twice its value (at least 1) to either side, in its bounds.
    """
    own = getattr(module, "PARAMETER", None)
    name = parameter or own or next(iter(system.parameter_names), None)
    if name is None:
        raise ModelError(f"system {system.name!r} has no parameter to vary; give it one.")
    if name == own and hasattr(module, "RANGE"):
        return name, (float(module.RANGE[0]), float(module.RANGE[1]))
    return name, default_reach(system, name)


def curves(
    system: System,
    parameter: str,
    interval: tuple[float, float],
    *,
    harmonics: int = 15,
    stability: bool = True,
    progress: Progress = silent,
) -> Curves:
    """Trace the branches from all Hopf points, and those through the cycles at the system's values.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    harmonics : int
        Highest harmonic.
    stability : bool
        Whether to compute the multipliers of every cycle.
    progress : callable
        Called with (message, fraction done or None).

    Raises
    ------
    ModelError
        For an unknown parameter or an empty interval. What cannot be computed is said in the notes.
    """
    interval = check_interval(system, parameter, interval)
    equations = HarmonicBalance(harmonics).equations(system)
    progress("looking for Hopf points", None)
    hopf = hopf_points(system, parameter, interval)
    traced: list[Branch] = []
    notes: list[str] = []
    for point in hopf:
        traced += _traced(equations, point, parameter, interval, progress, notes)
    value = system.values[parameter]
    progress(f"looking for cycles at {parameter} = {value:g}", None)
    cycles = [] if _holds_family(traced, interval, value) else _cycles(system, parameter, harmonics, stability, notes)
    for cycle in cycles:
        if interval[0] <= value <= interval[1] and not any(_passes(equations, b, cycle) for b in traced):
            traced += _traced(equations, cycle, parameter, interval, progress, notes)
    if _holds_family(traced, interval, value):
        cycles = []  # what was found is but one of the family
    families = [_cut(b, equations) for b in traced if is_family(b, interval)]
    branches = [b for b in traced if not is_family(b, interval)]
    if stability:
        told = [f"stability of branch {i + 1}" for i in range(len(branches))]
        branches = [judged(system, b, progress, text) for b, text in zip(branches, told, strict=True)]
    named = _named("branch", branches), _named("family", families)
    return Curves(parameter, interval, hopf, *named, cycles, tuple(notes))


def _cycles(system: System, parameter: str, harmonics: int, stability: bool, notes: list[str]) -> list[Orbit]:
    """Return the cycles at the system's parameter values, or none and a note why."""
    try:
        try:
            found = find_cycles(system, parameter=parameter, harmonics=harmonics, stability=stability)
        except ModelError:  # a continuous family, which is found by tracing from one of its cycles
            return settled_cycles(HarmonicBalance(harmonics).equations(system), parameter)
        return [o.replace(stability=stability_of(system, o)) for o in found] if stability else found
    except FAILURES as error:
        notes.append(f"Cycles at {parameter} = {system.values[parameter]:g}: {error}")
        return []


def _traced(
    equations: Equations,
    start: Orbit | SpecialPoint,
    parameter: str,
    interval: tuple[float, float],
    progress: Progress,
    notes: list[str],
) -> list[Branch]:
    """Return the branch from a start, or none and a note why."""

    def say(value: float) -> None:
        progress(f"tracing a branch: {parameter} = {value:.5g}", None)

    try:
        return [trace(equations, start, parameter, interval, max_points=MAX_POINTS, progress=say)]
    except FAILURES as error:
        place = start.value if isinstance(start, SpecialPoint) else start.parameters[parameter]
        what = "Hopf point" if isinstance(start, SpecialPoint) else "cycle"
        notes.append(f"No branch was traced from the {what} at {parameter} = {place:.6g}: {error}")
        return []


def _passes(equations: Equations, branch: Branch, cycle: Orbit) -> bool:
    """Tell whether a branch passes through a cycle."""
    try:
        on_branch = crossings(equations, branch, cycle.parameters[branch.parameter])
    except ModelError:
        return True  # a family: it holds cycles of every amplitude
    return len(distinct([*on_branch, cycle])) == len(on_branch)


def is_family(branch: Branch, interval: tuple[float, float]) -> bool:
    """Tell whether the parameter stays constant along a branch: a family of cycles of every amplitude."""
    return len(branch) > 1 and bool(np.ptp(branch.values) <= 1e-9 * (interval[1] - interval[0]))


def _holds_family(traced: Sequence[Branch], interval: tuple[float, float], value: float) -> bool:
    """Tell whether there is a family of cycles at a value of the parameter."""
    width = 1e-9 * (interval[1] - interval[0])
    return any(is_family(b, interval) and abs(b.values[0] - value) <= width for b in traced)


def _cut(family: Branch, equations: Equations) -> Branch:
    """Return the family up to a largest peak of the coordinate that sets the phase, by growing amplitude."""
    name = equations.system.coordinate_names[equations.phase or 0]
    peak = family.amplitude(name)
    order = np.argsort(peak, kind="stable")
    limit = max(LARGEST * float(equations.scale[0]), 2 * float(peak.min()))
    resolved = [i for i in order if family.orbits[i].tail <= RESOLVED]
    kept = [family.orbits[i] for i in resolved if peak[i] <= limit] or [family.orbits[order[-1]]]
    beginning = "the smallest cycle computed"
    if len(resolved) < len(order):
        beginning = (
            f"cycles whose highest harmonics exceed {100 * RESOLVED:g} % of the first are not resolved, nor shown"
        )
    ends = beginning, f"larger cycles than {limit:.4g} are not shown"
    return Branch(tuple(kept), family.parameter, (), ends)


def judged(system: System, branch: Branch, progress: Progress = silent, message: str = "stability") -> Branch:
    """Return the branch with the stability of every cycle.

    Parameters
    ----------
    system : System
    branch : Branch
    progress : callable
        Called with (message, fraction done).
    message : str
    """
    orbits = []
    for i, orbit in enumerate(branch.orbits):
        progress(message, i / len(branch))
        orbits.append(orbit.replace(stability=stability_of(system, orbit)))
    return branch.with_orbits(orbits)


def stability_of(system: System, orbit: Orbit) -> Stability | None:
    """Return the stability of a cycle; where it is unknown, that of the same cycle with more harmonics.

    Parameters
    ----------
    system : System
    orbit : Orbit
        Its stability is taken as it is where it has one.

    Returns
    -------
    Stability or None
        None where the multipliers cannot be computed at all.
    """
    try:
        first = orbit.stability or floquet(system, orbit)
    except FAILURES:
        return None
    verdict, finer = first, orbit
    while verdict.verdict == "unknown" and 0 < finer.H <= MOST_HARMONICS // 2:
        try:
            equations = HarmonicBalance(2 * finer.H + 1).equations(system)
            finer = solve(equations, finer, method="newton", **orbit.parameters)  # type: ignore[arg-type]
            if abs(finer.omega - orbit.omega) > 0.01 * orbit.omega:
                break  # another cycle, as may happen close to a fold
            verdict = floquet(system, finer)
        except FAILURES:
            break
    if verdict is first or verdict.verdict == "unknown":
        return first
    return replace(verdict, reason=f"{verdict.reason} Judged with harmonics up to {finer.H}.")


def _named(stem: str, branches: Sequence[Branch]) -> dict[str, Branch]:
    return {f"{stem}_{i + 1}" if len(branches) > 1 else stem: b for i, b in enumerate(branches)}
