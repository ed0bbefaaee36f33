"""Comparison of methods: the same cycles by describing functions, harmonic balance and a converged method."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np

from hbbogie.branches.choice import METHODS, chosen_methods
from hbbogie.branches.closed_form import exact_branch, exact_crossings, exact_walk
from hbbogie.branches.collocated import branch_of, followed_from
from hbbogie.branches.compared import Compared, Comparison, TracedBranch
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import crossings
from hbbogie.branches.cycles import find_cycles
from hbbogie.collocation.method import Collocation
from hbbogie.collocation.walk import Followed
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door, several
from hbbogie.exact.model import switched_linear
from hbbogie.methods.describing_balance import DescribingFunction
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError

TRUTH = "mhb61"
FAMILY = 1e-6  # share of the interval below which a branch does not vary: cycles of every amplitude at one value
EXACT, COLLOCATION = "exact", "collocation"
USUAL, CONVERGED = 15, "mhb63"  # highest harmonic of "mhb", and what "auto" is for a system that is not exact
DEFAULT_METHODS = ("df1", "df2", "mhb3", "mhb15")


def _cycles(equations: Equations, branch: Branch, value: float) -> Iterator[tuple[int, Orbit]]:
    for part, piece in enumerate(_parts(branch)):
        if len(piece) > 1:
            yield from ((part, orbit) for orbit in crossings(equations, piece, value))


def _collocated(followed: Followed, value: float) -> Iterator[tuple[int, Orbit]]:
    yield from ((part, cycle.orbit()) for part, cycle in followed.crossings(value))


def _parts(branch: Branch) -> list[Branch]:
    """Return the pieces of a branch between its folds."""
    turns = [s.value for s in branch.folds()]
    cuts = [0, *(i for i, o in enumerate(branch.orbits) if o.parameters[branch.parameter] in turns), len(branch) - 1]
    return [Branch(branch.orbits[a : b + 1], branch.parameter) for a, b in pairwise(cuts) if b > a]


def method_named(name: str) -> HarmonicBalance | DescribingFunction:
    """Return the method of a name such as "df1", "df2" or "mhb15"; raise `ModelError` for any other name.

    "exact", cycles in closed form, and "collocation" are none of these methods: they have no unknown harmonics; see
    `check_methods`.
    """
    found = re.fullmatch(r"(df)([12])|(mhb)([0-9]*)", name.strip().casefold())
    if found is None or name.strip().casefold() == "mhb0":
        raise ModelError(
            f"unknown method {name!r}; write df1 or df2 (describing function of first or second order), mhb and the "
            "highest harmonic, such as mhb15 (which mhb alone stands for), exact, collocation, or auto."
        )
    return DescribingFunction(order=int(found[2])) if found[1] else HarmonicBalance(int(found[4] or USUAL))


def check_methods(names: Iterable[str]) -> list[str]:
    """Return the names of methods in small letters, each once; raise `ModelError` where one is unknown."""
    given = several("methods, such as ['df1', 'mhb15']", names, str)
    chosen = list(dict.fromkeys(name.strip().casefold() for name in given))
    for name in chosen:
        if name not in METHODS:
            method_named(name)
    return chosen


def default_methods(system: System) -> tuple[list[str], tuple[str, ...]]:
    """Return those of the default methods that can do a system, and a sentence on each other."""
    kept, left_out = [], []
    for name in DEFAULT_METHODS:
        try:
            method_named(name).equations(system)
            kept.append(name)
        except ModelError as error:
            left_out.append(f"{name} is left out: {error}")
    return kept, tuple(left_out)


def _named(system: System, name: str) -> str:
    """Return what the name of a method stands for with a system: "auto" is "exact" or "mhb63"."""
    if name != "auto":
        return name
    first, *_ = chosen_methods("compare", system, name)
    return CONVERGED if first == "mhb" else first


def trace_by_method(
    system: System, name: str, origin: SpecialPoint | Orbit, parameter: str, interval: tuple[float, float]
) -> TracedBranch:
    """Trace the branch that begins at a Hopf point, or the one through a cycle, by the method of that name."""
    start = time.perf_counter()
    if name == EXACT:
        switched_linear(system)
        if isinstance(origin, Orbit):
            raise ModelError(f"compare: {EXACT} begins at Hopf points only; leave it out.")
        built = time.perf_counter()
        walk = exact_walk(system, origin, interval)
        followed = time.perf_counter()
        return TracedBranch(
            name, exact_branch(walk, origin), built - start, followed - built, partial(exact_crossings, walk)
        )
    if name == COLLOCATION:
        on_mesh = Collocation().equations(system)
        built = time.perf_counter()
        followed_branch = followed_from(on_mesh, origin, parameter, interval)
        followed = time.perf_counter()
        branch = branch_of(followed_branch, system, origin, stability=False)
        return TracedBranch(name, branch, built - start, followed - built, partial(_collocated, followed_branch))
    equations = method_named(name).equations(system)
    if isinstance(origin, Orbit):  # another method has found it
        equations = equations.phased(origin)
    equations.derivatives((system.parameter_names.index(parameter),))
    equations.derivatives(())
    built = time.perf_counter()
    branch = trace(equations, origin, parameter, interval, stability=False)
    tracing = time.perf_counter() - built
    return TracedBranch(name, branch, built - start, tracing, partial(_cycles, equations, branch))


@door(system=System, parameter=str, values=(list, tuple, np.ndarray))
def compare(
    system: System,
    methods: Sequence[str] | None = None,
    values: Sequence[float] | None = None,
    *,
    parameter: str | None = None,
    interval: tuple[float, float] | None = None,
    truth: str = TRUTH,
    progress: Progress = silent,
) -> Comparison:
    """Compute the cycles of the first branch from a Hopf point by several methods.

    Where a family of cycles begins there instead, as at mu = 0 of van der Pol, the branch through the first cycle found
    at the values of the system is taken.

    Parameters
    ----------
    system : System
    methods : sequence of str
        Names such as "df1" and "df2" (describing function of first, second order; creep forces, too, are linearised
        with all that they depend on sinusoidal), "mhb15" (multi-harmonic balance with its highest harmonic; "mhb" is
        "mhb15") and, for systems that are linear between switchings, "exact" (cycles in closed form), for smooth ones
        "collocation" (piecewise polynomials on a mesh that adapts). "auto" is "exact" where that applies, else "mhb63".
        Where left out: df1, df2, mhb3 and mhb15, as far as they can do the system; the result says what is left out.
    values : sequence of float, optional, unit of the parameter
        Where to compare; twelve values over the interval where left out.
    parameter : str, optional
        The system's first where left out.
    interval : (float, float), optional, unit of the parameter
        Where to trace; twice the parameter's value (at least 1) to either side where left out.
    truth : str
        Name of the converged method that the others are measured by.
    progress : callable
        Called with (message, fraction done).

    Returns
    -------
    Comparison

    Raises
    ------
    ModelError
        For an unknown method or parameter, a value outside the interval, or when there is no Hopf point in it.
    """
    name = parameter or system.parameter_names[0]
    span = interval or default_reach(system, name)
    for value in () if values is None else np.asarray(values, dtype=float):
        if not span[0] <= value <= span[1]:
            raise ModelError(
                f"compare: got {name} = {value:g}; give values from {span[0]:g} to {span[1]:g}, "
                "over which the branches are traced."
            )
    (truth,) = (_named(system, name) for name in check_methods([truth]))
    given, left_out = default_methods(system) if methods is None else (check_methods(methods), ())
    names = check_methods([_named(system, name) for name in [*given, truth]])
    hopf = hopf_points(system, name, span)
    if not hopf:
        raise ModelError(
            f"system {system.name!r} has no Hopf point for {name} from {span[0]:g} to {span[1]:g}; widen the interval."
        )
    progress(f"branch by {truth}", 0.0)
    origin, first = _branch_of_the_truth(system, truth, hopf[0], span)
    followed = {}
    for i, method in enumerate(names):
        progress(f"branch by {method}", i / (2 * len(names)))
        followed[method] = first if method == truth else trace_by_method(system, method, origin, name, span)
    V = first.branch.values
    chosen = np.linspace(V.min(), V.max(), 14)[1:-1] if values is None else np.asarray(values, dtype=float)
    rows: list[Compared] = []
    for i, value in enumerate(chosen):
        progress(f"cycles at {name} = {value:g}", 0.5 + i / (2 * len(chosen)))
        rows += _compared(followed, truth, float(value))
    compared = shown_coordinates(system)
    return Comparison(name, system.parameter(name).unit, compared, followed, truth, tuple(rows), left_out)


def shown_coordinates(system: System) -> tuple[str, ...]:
    """Return the coordinates on which elements act; all that enter nonlinearly, or the first, where there are none."""
    q, v, _, p = system.dynamics.symbols()
    arguments = [element.argument(q, v, p) for element in system.elements]
    directly = {i for i in range(system.n) for u in arguments if ca.is_equal(ca.simplify(u), q[i])}
    names = tuple(name for i, name in enumerate(system.coordinate_names) if i in directly)
    return names or system.nonlinear_coordinates or system.coordinate_names[:1]


def _branch_of_the_truth(
    system: System, truth: str, hopf: SpecialPoint, span: tuple[float, float]
) -> tuple[SpecialPoint | Orbit, TracedBranch]:
    """Return where the branch begins that is compared on, and that branch by the converged method."""
    name = hopf.parameter
    first = trace_by_method(system, truth, hopf, name, span)
    if np.ptp(first.branch.values) >= FAMILY * (span[1] - span[0]):
        return hopf, first
    value = system.values[name]
    if abs(value - hopf.value) > FAMILY * (span[1] - span[0]):
        for cycle in find_cycles(system, parameter=name, interval=span, stability=False):
            return cycle, trace_by_method(system, truth, cycle, name, span)
    raise ModelError(
        f"compare: from the Hopf point at {name} = {hopf.value:.6g} begins a family of cycles at that value, as in a "
        f"conservative system, and no cycle was found at {name} = {value:.6g} to follow instead; give the system a "
        f"value of {name} at which cycles exist."
    )


def _compared(followed: dict[str, TracedBranch], truth: str, value: float) -> list[Compared]:
    by_method: dict[str, dict[int, tuple[Orbit, float]]] = {}
    for name, method in followed.items():
        try:
            by_method[name] = method.at(value)
        except ConvergenceError:
            by_method[name] = {}
    rows = []
    for part, (orbit, _) in by_method[truth].items():
        found = {name: by_method[name].get(part) for name in followed if name != truth}
        orbits = {name: None if pair is None else pair[0] for name, pair in found.items()}
        seconds = {name: pair[1] for name, pair in found.items() if pair is not None}
        rows.append(Compared(value, part, orbit, orbits, seconds))
    return rows
