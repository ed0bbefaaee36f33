"""Jobs: what a study does at each point. A job takes a system and options and returns numbers and text by name.

Besides outputs it may return ``status``, a sentence, and ``failed``, whether the question stays without an answer. A
function of your own, at the top level of a file, is a job like these; its attribute ``units``, a dict by output, says
in which units its outputs are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hbbogie.comparison import compare as compare_methods
from hbbogie.continuation import trace
from hbbogie.critical import Critical, fold, hopf_gradient
from hbbogie.cycles import crossings, default_reach, find_cycles
from hbbogie.equations import Equations
from hbbogie.errors import ModelError, unknown_name
from hbbogie.guesses import hopf_points
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.problem import load_problem
from hbbogie.results import SpecialPoint
from hbbogie.studies.ladder import climb
from hbbogie.system import System

Outputs = dict[str, Any]
FAILURES = (RuntimeError, np.linalg.LinAlgError)  # ConvergenceError and CasADi's are among the first
NARROW = (1e-5, 1e-7)  # widths to which folds are bracketed, tried in turn
MAX_POINTS = 200  # of a branch
MARGIN = 0.05  # by which a branch goes on beyond its Hopf point's value, as a share of the interval below
STEPS = (0.02, 0.005, 0.1)  # first steps of a continuation, tried in turn


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
    search : {"lowest", "all"}
        "lowest" follows each branch from its Hopf point until it is back at the value there, "all" through the
        whole interval, as `hbbogie.critical_speeds` does, which takes three times as long. Below the first Hopf
        point, where the smallest critical value lies, both find the same folds; "lowest" keeps no others.

    Returns
    -------
    dict
        ``critical``, the smallest critical value, and its ``kind``; ``fold`` and ``hopf``, the smallest of each, with
        ``fold_omega``, ``hopf_omega`` [rad/s], ``fold_<coordinate>``, the peak of each nonlinear coordinate at the
        fold, numbers of ``folds`` and ``hopfs``, and the gradients. "No fold" with the evidence is an answer; a
        branch that cannot be followed is not.
    """
    if search not in ("lowest", "all"):
        raise ModelError(f"job critical: {unknown_name('search', search, ('lowest', 'all'))}")
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
    if search == "lowest":
        followed = [_lowest(equations, point, span, hopf.value) for point in points]
    else:
        followed = [_all(equations, point, span) for point in points]
    folds = [c for f in followed for c in f.folds]
    if search == "lowest":
        folds, where = [c for c in folds if c.value < hopf.value], f"from {span[0]:g} to the Hopf point"
    first = min(folds, key=lambda c: c.value, default=None)
    outputs: Outputs = {"kind": "hopf", "critical": hopf.value}
    if first is not None and first.value < hopf.value:
        outputs = {"kind": "fold", "critical": first.value}
    # a branch that got lost above the smallest critical value may still come down, but was not seen to
    failed = any(not f.complete and (f is followed[0] or f.lowest < outputs["critical"]) for f in followed)
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


def _lowest(equations: Equations, hopf: SpecialPoint, span: tuple[float, float], below: float) -> _Followed:
    """Follow a branch until it is back at its Hopf point's value; solve for the folds below a value."""
    for narrow in NARROW:
        try:
            ladder = climb(equations, hopf, span[0], narrow)
            if not ladder.complete:
                break
            near = [orbit for orbit in ladder.folds if orbit.parameters[hopf.parameter] < below]
            found = [fold(equations, orbit, hopf.parameter, search=False) for orbit in near]
            return _Followed(found, ladder.lowest, ladder.end, True)
        except FAILURES:
            continue
    # the longer way, by arclength
    return _all(equations, hopf, (span[0], min(span[1], hopf.value + MARGIN * (hopf.value - span[0]))))


def _all(equations: Equations, hopf: SpecialPoint, span: tuple[float, float]) -> _Followed:
    """Follow a branch through an interval."""
    reason = ""
    for step in STEPS:
        try:
            branch = trace(equations, hopf, hopf.parameter, span, step=step, max_points=MAX_POINTS, families=False)
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


def cycles(
    system: System, parameter: str = "V", interval: tuple[float, float] | None = None, harmonics: int = 15
) -> Outputs:
    """Find the cycles at the point's parameter values, by growing amplitude.

    Parameters
    ----------
    system : System
    parameter : str
        Along which branches are traced.
    interval : (float, float), optional, unit of the parameter
        Where to look for Hopf points.
    harmonics : int
        Highest harmonic.

    Returns
    -------
    dict
        ``cycles``, their number; of cycle k = 1, 2, ... ``omega_k`` [rad/s], ``peak_<coordinate>_k`` and
        ``stability_k``.
    """
    found = find_cycles(system, parameter=parameter, interval=interval, harmonics=harmonics)
    outputs: Outputs = {"cycles": len(found)}
    for k, orbit in enumerate(found, 1):
        outputs[f"omega_{k}"] = orbit.omega
        outputs |= {f"peak_{c}_{k}": orbit.amplitude(c) for c in orbit.coordinates}
        outputs[f"stability_{k}"] = orbit.stability.verdict if orbit.stability else "unknown"
    return outputs | {"status": f"{len(found)} cycle{'s' * (len(found) != 1)} found"}


def branch(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    harmonics: int = 15,
    at: Sequence[float] = (),
) -> Outputs:
    """Trace the branch from the first Hopf point.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
    harmonics : int
        Highest harmonic.
    at : sequence of float, unit of the parameter
        Where to give the peaks of the largest cycle.

    Returns
    -------
    dict
        ``hopf``, ``folds``, ``fold_1``, ...; ``lowest`` and ``highest`` value on the branch, ``points``; and
        ``omega_at_<value>`` and ``peak_<coordinate>_at_<value>`` where there is a cycle.
    """
    span = interval or default_reach(system, parameter)
    points = hopf_points(system, parameter, span)
    if not points:
        return {"folds": 0, "points": 0, "status": f"no Hopf point from {span[0]:g} to {span[1]:g}"}
    equations = HarmonicBalance(harmonics).equations(system)
    traced = trace(equations, points[0], parameter, span, families=False)
    outputs: Outputs = {"hopf": points[0].value, "folds": len(traced.folds()), "points": len(traced)}
    outputs |= {"lowest": traced.values.min(), "highest": traced.values.max()}
    outputs |= {f"fold_{k}": s.value for k, s in enumerate(traced.folds(), 1)}
    for value in at:
        orbits = crossings(equations, traced, float(value))
        if orbits:
            largest = max(orbits, key=lambda o: float(np.linalg.norm(o.coefficients[1:])))
            outputs[f"omega_at_{value:g}"] = largest.omega
            outputs |= {f"peak_{c}_at_{value:g}": largest.amplitude(c) for c in largest.coordinates}
    return outputs | {"status": f"branch from the Hopf point at {points[0].value:.6g}: {traced.ends[1]}"}


def compare(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    methods: Sequence[str] = ("df1",),
    truth: str = "mhb15",
    values: Sequence[float] | None = None,
) -> Outputs:
    """Compute the branch from the first Hopf point by several methods, and how far they are from a converged one.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
    methods : sequence of str
        Names such as "df1" and "mhb3".
    truth : str
        The method taken as the truth.
    values : sequence of float, optional, unit of the parameter
        Where to compare; twelve values over the interval where left out.

    Returns
    -------
    dict
        ``fold_<method>``, and of each but the truth, the largest over the values, ``omega_error_<method>`` and
        ``peak_<coordinate>_error_<method>`` [%].
    """
    found = compare_methods(system, methods, values, parameter=parameter, interval=interval, truth=truth)
    outputs: Outputs = {f"fold_{name}": followed.fold for name, followed in found.methods.items()}
    for method in found.approximations:
        for quantity, of in found.quantities().items():
            errors = [row.error(method, of) for row in found.rows]
            name = f"{quantity.replace(' ', '_')}_error_{method}"
            outputs[name] = max((abs(e) for e in errors if e is not None), default=None)
    return outputs | {"status": f"{len(found.rows)} cycles compared with {truth}"}


JOBS: dict[Any, Callable[..., Outputs]] = {"critical": critical, "cycles": cycles, "branch": branch, "compare": compare}


def job_function(job: str | Callable[..., Outputs]) -> Callable[..., Outputs]:
    """Return the function of a job.

    Parameters
    ----------
    job : str or callable
        Name of a job, "file.py:function", or the function itself.

    Raises
    ------
    ModelError
        When there is no such job, file or function.
    """
    if callable(job):
        return job
    if job in JOBS:
        return JOBS[job]
    file, colon, name = job.rpartition(":")
    if not colon or not file.endswith(".py"):
        raise ModelError(f'{unknown_name("job", job, JOBS)} Or a function of a file: "file.py:function".')
    if not Path(file).is_file():
        raise ModelError(f"job {job!r}: no file {file!r}.")
    module = load_problem(file)
    function = getattr(module, name, None)
    if not callable(function):
        own = [n for n, f in vars(module).items() if callable(f) and getattr(f, "__module__", "") == module.__name__]
        raise ModelError(f"job {job!r}: {unknown_name('function', name, own)}")
    return function  # type: ignore[no-any-return]


def output_units(
    function: Callable[..., Outputs], system: System, parameter: str, names: Sequence[str]
) -> dict[str, str]:
    """Return the unit of each output, an empty string where none is known.

    Parameters
    ----------
    function : callable
        A job.
    system : System
    parameter : str
        Whose critical values or branches the job computes.
    names : sequence of str
        Of the outputs.
    """
    own = dict(getattr(function, "units", {}))
    if function not in JOBS.values():
        return {name: own.get(name, "") for name in names}
    unit = system.parameter(parameter).unit if parameter in system.parameter_names else ""
    return {name: _unit(name, system, unit) for name in names}


def _unit(name: str, system: System, unit: str) -> str:
    """Return the unit of an output of the jobs of this module, by its name."""
    head, _, tail = name.partition("_d")
    if head in ("dfold", "dhopf") and tail in system.parameter_names:
        return f"({unit or '1'})/({system.parameter(tail).unit or '1'})"
    if "_error_" in name:
        return "%"
    if name in ("kind", "folds", "hopfs", "points", "cycles") or name.startswith("stability"):
        return ""
    if "omega" in name:
        return "rad/s"
    parts = name.split("_")
    for coordinate in system.coordinates:
        if coordinate.name in parts and parts[0] in ("peak", "fold"):
            return coordinate.unit
    return unit
