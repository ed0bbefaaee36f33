"""The bifurcation diagram at a view: followed from one at other values, or searched anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from hbbogie.branches.choice import is_switched_linear
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import crossings, is_family
from hbbogie.branches.cycles import find_cycles
from hbbogie.branches.diagram import Diagram, bifurcation_diagram, numbered, shown_part
from hbbogie.branches.same import once_each
from hbbogie.brief import brief
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.equilibria.find import find_equilibria
from hbbogie.errors import ModelError
from hbbogie.exact.method import Exact, ExactEquations
from hbbogie.explorer.view import View
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Branch, Equilibria, Orbit, SpecialPoint
from hbbogie.results.failure import FAILURES
from hbbogie.solving.solvers import solve

HARMONICS = 15  # highest harmonic of harmonic balance
LARGEST = 20  # states of a system without closed form
SECONDS = 60.0  # after which a search ends with what was found


@dataclass(frozen=True, eq=False)
class Explored:
    """A diagram with what belongs to it.

    Attributes
    ----------
    view : View
    system : System
        At the values of the view.
    equations : Equations or ExactEquations
        Of the cycles of the branches.
    diagram : Diagram
    equilibria : Equilibria
    complete : bool
        False where the limit of time ended the search.
    anew : bool
        Whether cycles were searched without those of a diagram before.
    peaks : dict of Orbit to float
        What is drawn over the parameter of the orbits for which it was computed.
    """

    view: View
    system: System
    equations: Equations | ExactEquations
    diagram: Diagram
    equilibria: Equilibria
    complete: bool
    anew: bool
    peaks: dict[Orbit, float] = field(default_factory=dict, repr=False)

    __repr__ = brief

    @property
    def curves(self) -> dict[str, Branch]:
        """Branches and families by name."""
        return {**self.diagram.branches, **self.diagram.families}


def explored(system: System, view: View, before: Explored | None = None, *, seconds: float = SECONDS) -> Explored:
    """Return the diagram at a view.

    Cycles are followed in closed form where the system is linear between switchings, else by harmonic balance. Branches
    begin at Hopf points, and at cycles of the diagram before; where that does not help, and without one, cycles are
    searched from nothing.

    Parameters
    ----------
    system : System
    view : View
    before : Explored, optional
        At other values.
    seconds : float, s
        Time after which the search ends with what was found.
    """
    here = system.with_parameters(**view.values)
    equations = equations_of(here)
    with time_limit(seconds):
        rest = find_equilibria(here, view.parameter, view.interval)
        hopf, anew = rest.special("hopf"), False
        found = None
        if before is not None and before.complete and before.curves and before.view.parameter == view.parameter:
            found = _onwards(equations, view, hopf, before)
        if found is None:
            found, anew = _searched(equations, view, hopf), True
        exact = bool(found.branches) and all(_exact(b) for b in found.branches.values())
        if isinstance(equations, ExactEquations) and not exact:
            equations = HarmonicBalance(HARMONICS).equations(here)
        return Explored(view, here, equations, found, rest, not time_is_over(), anew)


def check_explorable(system: System) -> None:
    """Raise `ModelError` for a system whose diagram would take minutes."""
    if system.n_states > LARGEST and not isinstance(equations_of(system), ExactEquations):
        raise ModelError(
            f"explore: system {system.name!r} has {system.n_states} states and no cycles in closed form, so that one "
            f"diagram would take minutes. Systems of up to {LARGEST} states, and those that are linear between "
            "switchings, can be explored; use the command branch for this one."
        )


def equations_of(system: System) -> Equations | ExactEquations:
    """Return the equations of cycles in closed form where there are such, else those of harmonic balance."""
    return Exact().equations(system) if is_switched_linear(system) else HarmonicBalance(HARMONICS).equations(system)


def _exact(branch: Branch) -> bool:
    return branch.orbits[0].method == "exact"


def _traced(
    equations: Equations | ExactEquations, start: Orbit | SpecialPoint, view: View, notes: list[str]
) -> list[Branch]:
    """Return the branch from a start, or none and a note why."""
    try:
        return [trace(equations, start, view.parameter, view.interval)]
    except FAILURES as error:
        notes.append(f"Not followed from the {getattr(start, 'kind', 'cycle').replace('hopf', 'Hopf point')}: {error}")
        return []


def _searched(equations: Equations | ExactEquations, view: View, hopf: Sequence[SpecialPoint]) -> Diagram:
    """Return the diagram without any known cycle."""
    system = equations.system
    if isinstance(equations, ExactEquations):
        notes: list[str] = []
        found = [b for point in hopf for b in _traced(equations, point, view, notes)]
        for cycle in _cycles(system, view):
            if not _on_any(equations, found, cycle):
                found += _traced(equations, cycle, view, notes)
        if found:
            return _diagram(view, hopf, found, notes)
    return bifurcation_diagram(system, view.parameter, view.interval, harmonics=HARMONICS)


def _cycles(system: System, view: View) -> list[Orbit]:
    """Return the cycles at the view's own value of the parameter on the axis, where it lies in the interval."""
    low, high = view.interval
    if not low <= system.values[view.parameter] <= high:
        return []
    try:
        return list(find_cycles(system, parameter=view.parameter, interval=view.interval))
    except FAILURES:
        return []


def _onwards(
    equations: Equations | ExactEquations, view: View, hopf: Sequence[SpecialPoint], before: Explored
) -> Diagram | None:
    """Return the diagram from its Hopf points and from the cycles of one before; None where these lead nowhere."""
    if before.diagram.families and not before.diagram.branches:
        return _families_onwards(equations.system, view, hopf, before)
    notes: list[str] = []
    found = [b for point in hopf for b in _traced(equations, point, view, notes)]
    onward = [s for b in found for s in b.special if s.onward is not None]
    for known in _lost(before, found):
        low, high = view.interval
        at: dict[str, Any] = {view.parameter: known.parameters[view.parameter]}
        if not low <= at[view.parameter] <= high:
            continue
        try:
            start = solve(equations, known, **at)
        except FAILURES:
            return None
        if _on_any(equations, found, start):
            continue
        more = _traced(equations, start, view, notes)
        if not more:
            return None
        found += more
        onward += [s for s in more[0].special if s.onward is not None]
    for point in onward:
        beyond = equations
        if isinstance(equations, Equations):
            H = 2 * HARMONICS if point.kind == "period doubling" else HARMONICS
            beyond = HarmonicBalance(H, odd=False).equations(equations.system)
        found += _traced(beyond, point, view, notes)
    return _diagram(view, hopf, found, notes) if found else None


def _families_onwards(system: System, view: View, hopf: Sequence[SpecialPoint], before: Explored) -> Diagram | None:
    """Return the families of cycles of every amplitude, each from one of its cycles; None where one is lost."""
    equations, notes = HarmonicBalance(HARMONICS).equations(system), list[str]()
    found: list[Branch] = []
    for family in before.diagram.families.values():
        more = _traced(equations, family.orbits[len(family) // 2], view, notes)
        if not more or not is_family(more[0], view.interval):
            return None  # cycles may now depend on the parameter
        found.append(shown_part(more[0], equations))
    return _diagram(view, hopf, found, notes)


def _lost(before: Explored, found: Sequence[Branch]) -> Iterator[Orbit]:
    """Give a cycle of each branch before that no Hopf point has led to again: one in its middle."""
    again = len([b for b in found if not is_family(b, before.view.interval)])
    known = list(before.diagram.branches.items())
    born = [b for _, b in known if any(s.kind == "hopf" for s in b.special)]
    beyond = ("pitchfork", "period_doubling", "branch_point")  # followed from where they begin
    for name, branch in known:
        if (branch in born and again >= len(born)) or name.startswith(beyond):
            continue
        yield branch.orbits[len(branch) // 2]


def _on_any(equations: Equations | ExactEquations, branches: Sequence[Branch], cycle: Orbit) -> bool:
    """Tell whether a cycle, solved for, lies on one of some branches."""
    for branch in branches:
        try:
            there = crossings(equations, branch, cycle.parameters[branch.parameter])  # type: ignore[arg-type]
        except FAILURES:
            continue
        if there and len(once_each([*there, cycle])) == len(once_each(there)):
            return True
    return False


def _diagram(view: View, hopf: Sequence[SpecialPoint], found: Sequence[Branch], notes: Sequence[str]) -> Diagram:
    families = [b for b in found if is_family(b, view.interval)]
    curves = [b for b in found if not is_family(b, view.interval)]

    return Diagram(
        view.parameter,
        view.interval,
        list(hopf),
        numbered("branch", curves),
        numbered("family", families),
        [],
        tuple(dict.fromkeys(notes)),
    )
