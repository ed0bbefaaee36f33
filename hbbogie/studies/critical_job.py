"""The job "critical": the smallest critical value of a parameter, with gradients and with the evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches import choice
from hbbogie.critical.speeds import criticals
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import named, pair, whole
from hbbogie.exact.critical import CriticalValues, NominalDesign, nominal_design
from hbbogie.exact.peaks import peaks
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
Outputs = dict[str, Any]
METHODS = (*choice.METHODS, "batch")
Interval = Annotated[tuple[float, float], pair]
Harmonics = Annotated[int, whole]


def smallest_critical(
    system: System,
    parameter: str = "V",
    interval: Interval | None = None,
    harmonics: Harmonics | None = None,
    gradients: bool = True,
    method: Literal["auto", "exact", "mhb", "collocation", "batch"] = "auto",
) -> Outputs:
    """Find the critical values of a parameter, with their gradients.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
        Where to look.
    harmonics : int, optional
        Highest harmonic, as for `hbbogie.critical_speeds`.
    gradients : bool
        Whether the outputs hold ``dfold_d<name>`` and ``dhopf_d<name>`` for every parameter.
    method : {"auto", "exact", "mhb", "collocation", "batch"}
        The first four are those of `hbbogie.critical_speeds`, whose answer is given. "batch" is that of
        `hbbogie.critical_speeds_of`, for systems that are linear between switchings, many points together: the first
        Hopf point and the fold below it, from the fold of the parameters' default values where that leads there; then
        ``complete`` is 0, since the branch is not followed, and a second fold may lie lower. Elsewhere the branches
        from all Hopf points are followed. It has no use for ``harmonics``, and does not count ``hopfs``.

    Returns
    -------
    dict
        ``critical``, the smallest critical value, and its ``kind``; ``fold``, the smallest below all Hopf points, with
        ``fold_error``, a bound of what the harmonics left out change in it; ``hopf``, the smallest; ``depth``, how far
        ``critical`` lies below ``hopf`` [%]; ``fold_omega``, ``hopf_omega`` [rad/s]; ``fold_<coordinate>``, the peak of
        each nonlinear coordinate at the fold; numbers of ``folds`` below all Hopf points and of ``hopfs``;
        ``complete``, 1 where every branch was followed to its end and 0 elsewhere; and the gradients. "No fold" with
        the evidence is an answer; a branch that cannot be followed is not.
    """
    named("job critical", "method", method, METHODS)
    span = (float(interval[0]), float(interval[1])) if interval else default_reach(system, parameter)
    if method == "batch":
        return _alone(system, parameter, span, gradients)
    found = criticals(system, parameter, span, method, harmonics, lowest=True)
    hopfs = [c for c in found if c.kind == "hopf"]
    folds = [c for c in found if c.kind == "fold" and (not hopfs or c.value < hopfs[0].value)]
    outputs: Outputs = {"kind": "", "folds": len(folds), "hopfs": len(hopfs), "complete": float(found.complete)}
    first = (folds or hopfs)[:1]
    where = f"from {span[0]:g} to {span[1]:g}"
    said = [] if hopfs else [f"no Hopf point {where}"]
    for c in first:
        outputs |= {"kind": c.kind, "critical": c.value}
    if hopfs:
        where = f"from {span[0]:g} to the Hopf point"
        outputs |= _values("hopf", hopfs[0].value, hopfs[0].omega, hopfs[0].gradient if gradients else {})
        outputs |= _depth(first[0].value, hopfs[0].value)
    for c in folds[:1]:
        outputs |= _values("fold", c.value, c.omega, c.gradient if gradients else {}) | {"fold_error": c.error}
        outputs |= {f"fold_{name}": c.orbit.amplitude(name) for name in system.nonlinear_coordinates}
    said += [
        f"fold at {c.value:.6g}{'' if c.gradient else ', without gradient'}{'' if c.resolved else ', not resolved'}"
        for c in folds[:1]
    ]
    said += [f"no fold {where}"] * (not folds)
    return outputs | {"status": "; ".join([*said, *found.evidence]), "failed": not found.complete}


def _values(kind: str, value: float, omega: float, gradient: dict[str, float]) -> Outputs:
    return {kind: value, f"{kind}_omega": omega} | {f"d{kind}_d{name}": slope for name, slope in gradient.items()}


def _depth(critical: float, hopf: float) -> Outputs:
    return {"depth": 100 * (1 - critical / hopf)} if hopf else {}


def critical_of_many(
    system: System,
    points: Sequence[Mapping[str, float]],
    parameter: str = "V",
    interval: Interval | None = None,
    harmonics: Harmonics | None = None,
    gradients: bool = True,
    method: str = "batch",
) -> list[Outputs]:
    """Do the job with ``method="batch"`` at many points together.

    Parameters
    ----------
    system : System
    points : sequence of mappings
        Parameter values of each point, by name, in the unit of each.
    parameter, interval, harmonics, gradients, method
        As for `smallest_critical`.
    """
    systems = [system.with_parameters(**point) for point in points]
    span = (float(interval[0]), float(interval[1])) if interval else default_reach(system, parameter)
    nominal = _nominal(system, parameter, span)
    found = nominal.critical_values(np.array([one.vector() for one in systems]))
    heights = iter(peaks([fold for fold in found.folds if fold]))
    rows = [
        _outputs(one, found, d, next(heights) if found.folds[d] else None, parameter, gradients)
        for d, one in enumerate(systems)
    ]
    for d in np.flatnonzero(found.failed):  # where the closed form is lost, harmonic balance may not be
        rows[d] = smallest_critical(systems[d], parameter, span, gradients=gradients)
    return rows


def _nominal(system: System, parameter: str, span: tuple[float, float]) -> NominalDesign:
    """Return the default parameter values as the design from which searches begin; it is built once."""
    own = system.with_parameters(**{p.name: p.default for p in system.parameters})
    return system.once(("nominal design", parameter, span), lambda: nominal_design(own, parameter, span))


def _alone(system: System, parameter: str, span: tuple[float, float], gradients: bool) -> Outputs:
    """Return the outputs of the job from cycles in closed form."""
    try:
        return critical_of_many(system, [{}], parameter, span, gradients=gradients)[0]
    except ConvergenceError:  # the point is its own beginning
        if not hopf_points(system, parameter, span):
            return {"kind": "", "folds": 0, "status": f"no Hopf point from {span[0]:g} to {span[1]:g}"}
        found = nominal_design(system, parameter, span).critical_values(system.vector()[None])
    high = next(iter(peaks([fold for fold in found.folds if fold])), None)
    return _outputs(system, found, 0, high, parameter, gradients)


def _outputs(
    system: System, found: CriticalValues, d: int, high: Array | None, parameter: str, gradients: bool
) -> Outputs:
    """Return the outputs of one of the designs whose critical values were found together, with the fold's peaks."""
    fold, hopf, status, failed = found.folds[d], float(found.hopf.value[d]), found.status[d], bool(found.failed[d])

    def named(gradient: Array) -> dict[str, float]:
        by_name = zip(system.parameter_names, map(float, gradient), strict=True)
        return {name: slope for name, slope in by_name if name != parameter} if gradients else {}

    outputs: Outputs = {"kind": "", "folds": int(fold is not None), "complete": float(found.complete[d])}
    if fold is not None:
        outputs |= {"kind": "fold", "critical": fold.value}
    elif not np.isnan(hopf) and not failed:
        outputs |= {"kind": "hopf", "critical": hopf}
    if not np.isnan(hopf):
        outputs |= _values("hopf", hopf, float(found.hopf.omega[d]), named(found.hopf.gradient[d]))
        outputs |= _depth(outputs["critical"], hopf) if not failed else {}
    if fold is not None and high is not None:
        outputs |= _values("fold", fold.value, fold.omega, named(fold.gradient)) | {"fold_error": 0.0}
        places = [(c, system.coordinate_names.index(c)) for c in system.nonlinear_coordinates]
        outputs |= {f"fold_{c}": float(high[place]) for c, place in places}
        status = f"fold at {fold.value:.6g}; {status}"
    return outputs | {"status": status, "failed": failed}
