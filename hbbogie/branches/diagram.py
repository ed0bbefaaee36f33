"""All curves of cycles over an interval of a parameter: branches, and families of conservative systems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hbbogie.branches.changing import Changing
from hbbogie.branches.choice import chosen_methods, equations_of
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import is_family
from hbbogie.branches.cycles import ORDERS, find_cycles
from hbbogie.branches.judging import estimate, stability_of
from hbbogie.branches.passing import is_near, passes
from hbbogie.branches.simulated import settled_cycles
from hbbogie.brief import lines
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door, whole
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.parallel import each, in_processes
from hbbogie.progress import Progress, silent
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import FAILURES

MAX_POINTS = 600  # of a branch; the family of a conservative system has no end
RESOLVED = 1e-3  # tail of the spectrum up to which a cycle of a family is shown
LARGEST = 10.0  # peak up to which a family is shown, in units of the amplitude scale
Task = tuple[str | HarmonicBalance, Orbit | SpecialPoint, bool]  # method, start, and whether to judge stability


@dataclass(frozen=True, eq=False)
class Diagram:
    """What exists over an interval of a parameter: a bifurcation diagram.

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

    def __repr__(self) -> str:
        low, high = self.interval
        curves = [f"{n}: {repr(b).partition(chr(10))[0]}" for n, b in {**self.branches, **self.families}.items()]
        hopf = ", ".join(f"{s.value:.9g}" for s in self.hopf) or "none"
        return lines(
            f"Bifurcation diagram over {self.parameter} = {low:g} to {high:g}",
            f"Hopf points: {hopf}; cycles at the values of the system: {len(self.cycles)}",
            *(curves or ["no branch"]),
            *self.notes,
        )


@door(system=System, parameter=str)
def bifurcation_diagram(
    system: System,
    parameter: str,
    interval: tuple[float, float],
    *,
    method: str = "mhb",
    harmonics: int | str = "auto",
    tolerance: float = 1e-3,
    stability: bool = True,
    max_points: int = MAX_POINTS,
    workers: int = 1,
    progress: Progress = silent,
) -> Diagram:
    """Trace the branches from all Hopf points, those through the system's cycles, and what begins on them.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    method : {"mhb", "auto", "exact", "collocation"}
        "exact" follows the branches in closed form and "collocation" as piecewise polynomials, without the families of
        conservative systems. "auto" is "exact" where the system is linear between switchings, else "mhb"; of a smooth
        system whose cycles 63 harmonics do not resolve a branch changes over to collocation there, and back: the
        ``method`` of its orbits says where.
    harmonics : int or "auto"
        Highest harmonic of "mhb". "auto" begins with 15 and doubles, up to 127, until the error estimate by shooting of
        the least resolved cycle on every branch meets the tolerance; the notes say what it took.
    tolerance : float
        Largest error of frequency and waveform, relative, that "auto" is content with.
    stability : bool
        Whether to compute the multipliers of every cycle, locate the special points, and follow the branches that
        begin at pitchforks, period doublings and branch points.
    max_points : int
        Points of a branch at which it ends.
    workers : int
        Processes among which the branches are shared; a script that asks for several does so below
        ``if __name__ == "__main__":``.
    progress : callable
        Called with (message, fraction done or None).

    Raises
    ------
    ModelError
        For an unknown parameter or an empty interval, or a method that does not apply. What cannot be computed is said
        in the notes.
    """
    with in_processes(workers):
        interval = check_interval(system, parameter, interval)
        given = None if harmonics == "auto" else harmonics
        method, *others = chosen_methods("bifurcation_diagram", system, method, given, along=parameter)
        changes = method == "mhb" and "collocation" in others
        progress("looking for Hopf points", None)
        hopf = hopf_points(system, parameter, interval)
        about = _About(
            system, parameter, interval, hopf, whole("bifurcation_diagram: max_points", max_points, 2), progress
        )
        if method != "mhb":
            return about.by(method, stability)
        cycles: list[Orbit] | None = None
        orders = ORDERS[:-1] if changes else ORDERS  # with more of them collocation takes less
        for H in orders if harmonics == "auto" else (int(harmonics),):
            notes, said = list[str](), list[str]()
            progress(f"branches with harmonics up to {H}", None)
            traced = about.traced(H, False, notes)
            family = _holds_family(traced, interval, system.values[parameter])
            if cycles is None:
                cycles = [] if family else _cycles(system, parameter, harmonics, stability, notes)
            traced = about.through(cycles, traced, H, False, notes)
            if harmonics != "auto":
                break
            error, said = estimate(system, [b for b in traced if not is_family(b, interval)], H, tolerance)
            if error <= tolerance or time_is_over():
                break
        changes = changes and harmonics == "auto" and error > tolerance
        if changes and not _holds_family(traced, interval, system.values[parameter]):
            said = [f"Where {H} harmonics do not resolve the cycles the branches go on by collocation."]
            about = replace(about, changing=H)
            traced = (
                traced if stability else about.through(cycles or (), about.traced(H, False, notes), H, False, notes)
            )
        notes += said
        if _holds_family(traced, interval, system.values[parameter]):
            cycles = []  # what was found is but one of the family
        families = [shown_part(b, HarmonicBalance(H).equations(system)) for b in traced if is_family(b, interval)]
        if stability:
            traced = about.through(cycles or (), about.traced(H, True, notes), H, True, notes)
        branches = [b for b in traced if not is_family(b, interval)]
        named = numbered("branch", branches) | about.beyond(branches, families, H, notes)
        return Diagram(
            parameter, interval, hopf, named, numbered("family", families), cycles or [], tuple(dict.fromkeys(notes))
        )


@dataclass(frozen=True, eq=False)
class _About:
    """What all branches of one job have in common."""

    system: System
    parameter: str
    interval: tuple[float, float]
    hopf: list[SpecialPoint]
    max_points: int
    progress: Progress
    changing: int = 0  # harmonics from which branches change over to collocation; none where they do not

    def by(self, method: str, stability: bool) -> Diagram:
        """Return the branches in closed form, or by collocation."""
        notes = [f"The branches are followed by the method {method!r}."]
        branches = self.followed(method, self.hopf, stability, notes)
        cycles = list[Orbit]()
        try:
            cycles = find_cycles(self.system, parameter=self.parameter, method=method, stability=stability)
        except FAILURES as error:
            notes.append(f"Cycles at {self.parameter} = {self.system.values[self.parameter]:g}: {error}")
        inside = self.interval[0] <= self.system.values[self.parameter] <= self.interval[1]
        for cycle in cycles if inside else ():
            if not any(is_near(branch, cycle) for branch in branches):
                branches += self.followed(method, [cycle], stability, notes)
        named = numbered("branch", branches)
        for kind in {s.kind for b in branches for s in b.special if s.onward is not None}:
            starts = [s for b in branches for s in b.special if s.kind == kind and s.onward is not None]
            named |= numbered(kind.replace(" ", "_"), self.followed(method, starts, stability, notes))
        return Diagram(self.parameter, self.interval, self.hopf, named, {}, cycles, tuple(dict.fromkeys(notes)))

    def followed(
        self, method: str | HarmonicBalance, starts: Sequence[Orbit | SpecialPoint], stability: bool, notes: list[str]
    ) -> list[Branch]:
        """Return the branches from some starts, with a note why for each that has none."""
        found = self.branches([(method, start, stability) for start in starts])
        notes += [note for _, note in found if note]
        return [branch for branches, _ in found for branch in branches]

    def branches(self, tasks: Sequence[Task]) -> list[tuple[list[Branch], str]]:
        """Return the branch from each start by its method, or none and a note why."""
        common = replace(self, progress=silent)  # for other processes
        return each(_one, common, tasks, self.progress, "tracing a branch")

    def traced(self, H: int, stability: bool, notes: list[str]) -> list[Branch]:
        """Return the branches from the Hopf points."""
        return self.followed(HarmonicBalance(H), self.hopf, stability, notes)

    def through(
        self, cycles: Sequence[Orbit], known: Sequence[Branch], H: int, stability: bool, notes: list[str]
    ) -> list[Branch]:
        """Return the branches known, and those through cycles that lie on none of them."""
        equations, found = HarmonicBalance(H).equations(self.system), list(known)
        inside = self.interval[0] <= self.system.values[self.parameter] <= self.interval[1]
        for cycle in cycles if inside else ():
            if not any(is_near(b, cycle) if self.changing else passes(equations, b, cycle) for b in found):
                found += self.followed(HarmonicBalance(H), [cycle], stability, notes)
        return found

    def beyond(self, branches: list[Branch], families: list[Branch], H: int, notes: list[str]) -> dict[str, Branch]:
        """Return the branches that begin at special points of others, by the kind of the point."""
        found: dict[str, list[Branch]] = {}
        starts = [
            special
            for branch in branches
            for special in branch.special  # but for what crosses a family, which is known
            if special.onward is not None and not _holds_family(families, self.interval, special.value, 1e-6)
        ]
        orders = (2 * H if special.kind == "period doubling" else H for special in starts)
        tasks = [(HarmonicBalance(K, odd=False), special, True) for K, special in zip(orders, starts, strict=True)]
        for special, (beyond, note) in zip(starts, self.branches(tasks), strict=True):
            notes += [note] if note else []
            if special.kind == "pitchfork":
                beyond = [_one_half(b) for b in beyond]
                notes.append(
                    "Of two asymmetric branches one is shown: the other is its mirror image, q(t) = -q(t + T/2)."
                )
            found.setdefault(special.kind.replace(" ", "_"), []).extend(beyond)
        return {name: b for kind, many in found.items() for name, b in numbered(kind, many).items()}


def _one(
    about: _About, method: str | HarmonicBalance, start: Orbit | SpecialPoint, stability: bool, progress: Progress
) -> tuple[list[Branch], str]:
    """Return the branch from a start, or none and a note why."""

    def say(value: float) -> None:
        progress(f"tracing a branch: {about.parameter} = {value:.5g}", None)

    system, name, interval = about.system, about.parameter, about.interval
    options: dict[str, Any] = {"max_points": about.max_points, "stability": stability, "progress": say}
    try:
        begins = isinstance(start, SpecialPoint) and start.onward is not None  # its harmonics are others
        if about.changing and isinstance(method, HarmonicBalance) and not begins:
            return [Changing(system, name, interval, about.changing, **options).trace(start)], ""
        equations = equations_of(method, system) if isinstance(method, str) else method.equations(system)
        return [trace(equations, start, name, interval, **options)], ""
    except FAILURES as error:
        place = start.value if isinstance(start, SpecialPoint) else start.parameters[name]
        what = start.kind.replace("hopf", "Hopf point") if isinstance(start, SpecialPoint) else "cycle"
        return [], f"No branch was traced from the {what} at {name} = {place:.6g}: {error}"


def _one_half(branch: Branch) -> Branch:
    """Return a branch through a pitchfork from there on."""
    fork = next((s.orbit for s in branch.special if s.kind == "pitchfork"), branch.orbits[0])
    start = next((i for i, o in enumerate(branch.orbits) if o is fork), 0)
    kept = {id(o) for o in branch.orbits[start:]}
    special = tuple(s for s in branch.special if id(s.orbit) in kept)
    return Branch(
        branch.orbits[start:],
        branch.parameter,
        special,
        (Ending("began", "began here, at the pitchfork"), branch.ends[1]),
    )


def _cycles(system: System, parameter: str, harmonics: int | str, stability: bool, notes: list[str]) -> list[Orbit]:
    """Return the cycles at the system's parameter values, or none and a note why."""
    try:
        try:
            found = find_cycles(system, parameter=parameter, harmonics=harmonics, stability=stability)
        except ModelError:  # a continuous family, which is found by tracing from one of its cycles
            H = ORDERS[0] if harmonics == "auto" else int(harmonics)
            return settled_cycles(HarmonicBalance(H).equations(system), parameter)
        return [o.replace(stability=stability_of(system, o)) for o in found] if stability else found
    except FAILURES as error:
        notes.append(f"Cycles at {parameter} = {system.values[parameter]:g}: {error}")
        return []


def _holds_family(
    traced: Sequence[Branch], interval: tuple[float, float], value: float, tolerance: float = 1e-9
) -> bool:
    """Tell whether there is a family of cycles at a value of the parameter."""
    width = tolerance * (interval[1] - interval[0])
    return any(is_family(b, interval) and abs(b.values[0] - value) <= width for b in traced)


def shown_part(family: Branch, equations: Equations) -> Branch:
    """Return the family up to a largest peak of the coordinate that sets the phase, by growing amplitude."""
    name = equations.system.coordinate_names[equations.phase or 0]
    peak = family.amplitude(name)
    order = np.argsort(peak, kind="stable")
    limit = max(LARGEST * float(equations.scale[0]), 2 * float(peak.min()))
    resolved = [i for i in order if family.orbits[i].tail <= RESOLVED]
    kept = [family.orbits[i] for i in resolved if peak[i] <= limit] or [family.orbits[order[-1]]]
    beginning = Ending("began", "the smallest cycle computed")
    if len(resolved) < len(order):
        unresolved = (
            f"cycles whose highest harmonics exceed {100 * RESOLVED:g} % of the first are not resolved, nor shown"
        )
        beginning = Ending("shown", unresolved)
    end = Ending("shown", f"larger cycles than {limit:.4g} are not shown")
    return Branch(tuple(kept), family.parameter, (), (beginning, end))


def numbered(stem: str, branches: Sequence[Branch]) -> dict[str, Branch]:
    """Return branches by name: the stem, with a number where there are several."""
    return {f"{stem}_{i + 1}" if len(branches) > 1 else stem: b for i, b in enumerate(branches)}
