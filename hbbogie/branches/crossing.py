"""Where branches cross a value of the parameter: the cycles there."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.branches.continuation import balanced_trace, trace
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.motion.integration import initial_state
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.orbit import Orbit
from hbbogie.solving.solvers import solve

Array = NDArray[np.float64]
COARSE = 15  # highest harmonic with which a family is looked at
MEMBERS = 150  # cycles of a family at one value of the parameter that are looked at


def branches_from_hopf(equations: Equations, parameter: str, interval: tuple[float, float]) -> list[Branch]:
    """Trace the branches that begin at each Hopf point in an interval of the parameter (see `from_hopf`)."""
    found: list[Branch] = []
    for hopf in hopf_points(equations.system, parameter, interval):
        with suppress(ConvergenceError):  # no cycle of the kept harmonics begins here
            found += from_hopf(equations, hopf, parameter, interval)
    return found


def from_hopf(
    equations: Equations,
    hopf: SpecialPoint,
    parameter: str,
    interval: tuple[float, float],
    unresolved: float = np.inf,
    **options: Any,
) -> list[Branch]:
    """Trace the branch from a Hopf point, and those that leave it where all its cycles have one value of the parameter.

    Of such a family, as of a linear or conservative limit, some members are on branches that cross it, at amplitudes
    at which the derivative in the parameter is orthogonal to the left null vector (Melnikov's condition).
    They end where the share of the highest harmonics is beyond what is ``unresolved``. Further options are those of
    `balanced_trace`.

    Raises
    ------
    ConvergenceError
        When no cycle is found next to the Hopf point.
    """
    single: dict[str, Any] = {"stability": False, "families": False, "unresolved": unresolved, **options}
    branch = balanced_trace(equations, hopf, parameter, interval, **single)
    if not is_family(branch, interval):
        return [branch]
    found, family = [branch], trace(equations, hopf, parameter, interval, max_points=MEMBERS, stability=False)
    for special in family.special:
        if special.onward is not None:
            with suppress(ConvergenceError):
                found.append(balanced_trace(equations, special, parameter, interval, **single))
    return found


def is_family(branch: Branch, interval: tuple[float, float]) -> bool:
    """Tell whether the parameter stays constant along a branch: a family of cycles of every amplitude."""
    return len(branch) > 1 and bool(np.ptp(branch.values) <= 1e-9 * (interval[1] - interval[0]))


def crossings(equations: Equations, branch: Branch, value: float) -> list[Orbit]:
    """Return the cycles of a branch at a value of its parameter, solved for exactly.

    Raises
    ------
    ModelError
        When the branch stays at the value: cycles of a conservative system form a family.
    """
    name, V = branch.parameter, branch.values
    at: dict[str, Any] = {name: value}
    near = np.abs(V - value) <= 1e-9 * max(1.0, abs(value), float(np.ptp(V)))
    if (near[:-1] & near[1:]).any():
        at_value = equations.system.with_parameters(**at)
        raise ModelError(family_message(at_value, name, branch.orbits[int(np.argmin(np.abs(V - value)))]))
    found = []
    for i in _passed(V, value):
        for guess in (_between(branch, i, value), branch.orbits[i], branch.orbits[i + 1]):
            try:
                found.append(solve(equations, guess, **at))
                break
            except ConvergenceError:
                continue
    return found


def near_crossings(branch: Branch, value: float) -> list[Orbit]:
    """Return a guess of each cycle of a branch at a value of its parameter, between two that were followed."""
    return [_between(branch, i, value) for i in _passed(branch.values, value)]


def _passed(values: Array, value: float) -> list[int]:
    """Return after which points of a branch a value of its parameter is passed."""
    away = values - value
    return [int(i) for i in np.flatnonzero((away[:-1] * away[1:] <= 0) & (away[:-1] != away[1:]))]


def _between(branch: Branch, i: int, value: float) -> Orbit:
    """Return what lies between the cycles at a place of a branch and at the next one."""
    a, b = branch.orbits[i], branch.orbits[i + 1]
    share = (value - branch.values[i]) / (branch.values[i + 1] - branch.values[i])
    return a.replace(
        coefficients=(1 - share) * a.coefficients + share * b.coefficients,
        omega=(1 - share) * a.omega + share * b.omega,
    )


def complete(branch: Branch) -> bool:
    """Tell whether a branch was followed to both its ends."""
    return all(end.complete for end in branch.ends)


def extent(name: str, values: ArrayLike, ends: Iterable[Ending], how: str = "") -> str:
    """Return a sentence on where a branch, which has a name, was followed, how, and why it ended."""
    why = "; ".join(str(end) for end in ends if end.kind != "began")
    return f"{name} was followed{how and ' ' + how} from {np.min(values):.6g} to {np.max(values):.6g}: {why}"


def family_message(system: System, name: str, orbit: Orbit) -> str:
    """Return what to say where the cycles at a value of a parameter form a continuous family, and what to try.

    Parameters
    ----------
    system : System
        At the value.
    name : str
        Of the parameter.
    orbit : Orbit
        A cycle of the family.
    """
    equations = HarmonicBalance(COARSE).equations(system).phased(orbit)
    coordinate, value = system.coordinate_names[equations.phase or 0], system.values[name]
    states = ", ".join(f"{x:.4g}" for x in initial_state(system, orbit)[1])
    through = "from other states"
    if not equations.advance:
        through = f"by their amplitude, solve(equations, guess, amplitude={{{coordinate!r}: size}}, {name}={value:g})"
    return (
        f"the cycles at {name} = {value:g} form a continuous family (as in a conservative system). Take one near a "
        f"state, guess = hbbogie.branches.cycle_after(system.with_parameters({name}={value:g}), [{states}]), and "
        f"others {through}; trace(equations, guess, {name!r}, interval) follows one over {name}."
    )
