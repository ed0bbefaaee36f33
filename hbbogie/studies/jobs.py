"""Jobs: what a study does at each point. A job takes a system and options and returns numbers and text by name.

Besides outputs it may return ``status``, a sentence, and ``failed``, which tells whether no answer was found. A
function of your own, at the top level of a file, is a job like these. Its attribute ``units``, a dict by output, gives
the units of its outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hbbogie.branches.comparison import compare as compare_methods
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import crossings
from hbbogie.branches.cycles import find_cycles
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.problem import load_problem
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.studies.critical_job import Harmonics, Interval, Outputs, critical_of_many, smallest_critical

__all__ = ["JOBS", "Outputs", "branch", "compare", "cycles", "job_function", "output_units", "smallest_critical"]


def cycles(
    system: System, parameter: str = "V", interval: Interval | None = None, harmonics: Harmonics = 15
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
        ``cycles``, their number; of cycle k = 1, 2, ... ``omega_k`` [rad/s], ``peak_<coordinate>_k``,
        ``peak_<output>_k``, ``rms_<output>_k`` (with " over " for a slash in its name) and ``stability_k``;
        ``evidence``, what was searched (see `find_cycles`).
    """
    found = find_cycles(system, parameter=parameter, interval=interval, harmonics=harmonics)
    outputs: Outputs = {"cycles": len(found)}
    for k, orbit in enumerate(found, 1):
        outputs[f"omega_{k}"] = orbit.omega
        outputs |= _numbers(orbit, str(k))
        outputs[f"stability_{k}"] = orbit.stability.verdict if orbit.stability else "unknown"
    outputs["evidence"] = "; ".join(found.evidence)
    return outputs | {"status": f"{len(found)} cycle{'s' * (len(found) != 1)} found"}


def branch(
    system: System,
    parameter: str = "V",
    interval: Interval | None = None,
    harmonics: Harmonics = 15,
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
        ``omega_at_<value>``, ``peak_<coordinate>_at_<value>``, ``peak_<output>_at_<value>`` and
        ``rms_<output>_at_<value>`` where there is a cycle.
    """
    span = interval or default_reach(system, parameter)
    points = hopf_points(system, parameter, span)
    if not points:
        return {"folds": 0, "points": 0, "status": f"no Hopf point from {span[0]:g} to {span[1]:g}"}
    equations = HarmonicBalance(harmonics).equations(system)
    traced = trace(equations, points[0], parameter, span, families=False, stability=False)
    outputs: Outputs = {"hopf": points[0].value, "folds": len(traced.folds()), "points": len(traced)}
    outputs |= {"lowest": traced.values.min(), "highest": traced.values.max()}
    outputs |= {f"fold_{k}": s.value for k, s in enumerate(traced.folds(), 1)}
    for value in at:
        orbits = crossings(equations, traced, float(value))
        if orbits:
            largest = max(orbits, key=lambda o: float(np.linalg.norm(o.coefficients[1:])))
            outputs[f"omega_at_{value:g}"] = largest.omega
            outputs |= _numbers(largest, f"at_{value:g}")
    return outputs | {"status": f"branch from the Hopf point at {points[0].value:.6g}: {traced.ends[1]}"}


def _numbers(orbit: Orbit, which: str) -> Outputs:
    """Return the peaks of coordinates and outputs of a cycle, and the rms of outputs, as outputs of a job."""
    peaks: Outputs = {f"peak_{name}_{which}": orbit.amplitude(name) for name in orbit.coordinates}
    for name in orbit.outputs:
        own = _stored(name)
        peaks |= {f"peak_{own}_{which}": orbit.amplitude(name), f"rms_{own}_{which}": orbit.rms(name)}
    return peaks


def _stored(output: str) -> str:
    """Return the name of a system's output as NetCDF can hold it: "Y over Q" for "Y/Q"."""
    return output.replace("/", " over ")


def compare(
    system: System,
    parameter: str = "V",
    interval: Interval | None = None,
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


JOBS: dict[Any, Callable[..., Outputs]] = {
    "critical": smallest_critical,
    "cycles": cycles,
    "branch": branch,
    "compare": compare,
}


SEARCHING = (smallest_critical, branch, compare)  # along a parameter, whose own value they do not use

# what does a job at many points together where its method is "batch": (system, points, **options) -> outputs of each
BATCHES: dict[Any, Callable[..., list[Outputs]]] = {smallest_critical: critical_of_many}


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
        if not hasattr(job, "__qualname__"):
            raise ModelError(
                f"job {job!r} is of type {type(job).__name__}; give a function, and what else it needs as options."
            )
        return job
    if not isinstance(job, str):
        raise ModelError(f"job {job!r} is of type {type(job).__name__}; give a name or a function.")
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
    for own in system.output_names:
        if name.startswith((f"peak_{_stored(own)}_", f"rms_{_stored(own)}_")):
            return system.naming.units.get(own, "")
    head, _, tail = name.partition("_d")
    if head in ("dfold", "dhopf") and tail in system.parameter_names:
        return f"({unit or '1'})/({system.parameter(tail).unit or '1'})"
    if "_error_" in name or name == "depth":
        return "%"
    if name in ("evidence", "kind", "folds", "hopfs", "points", "cycles") or name.startswith("stability"):
        return ""
    if "omega" in name:
        return "rad/s"
    parts = name.split("_")
    for coordinate in system.coordinates:
        if coordinate.name in parts and parts[0] in ("peak", "fold"):
            return coordinate.unit
    return unit
