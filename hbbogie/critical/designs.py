"""Critical values of many designs: all at once for systems that are linear between switchings, else one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.branches.choice import is_switched_linear
from hbbogie.brief import brief
from hbbogie.critical.speeds import critical_speeds
from hbbogie.errors import ModelError, door
from hbbogie.exact.critical import critical_values
from hbbogie.model.ranges import check_interval, default_reach
from hbbogie.model.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CriticalDesigns:
    """Critical values of a parameter for D designs, each with its gradient; NaN stands for what does not exist.

    Attributes
    ----------
    parameter : str
    points : dict of ndarray, each of shape (D,)
        The parameters that were given, by name, in the unit of each.
    fold : ndarray, shape (D,), unit of the parameter
        The smallest fold, below the Hopf point, of the branch that begins there.
    fold_omega : ndarray, shape (D,), rad/s
    fold_gradient : dict of ndarray, each of shape (D,), unit of the parameter per unit of each
        Derivative of the fold's value in every other parameter, by name.
    hopf : ndarray, shape (D,), unit of the parameter
        The Hopf point at which the equilibrium loses its stability.
    hopf_omega : ndarray, shape (D,), rad/s
    hopf_gradient : dict of ndarray, each of shape (D,), unit of the parameter per unit of each
    failed : ndarray of bool, shape (D,)
        Whether it is not known if there is a fold.
    complete : ndarray of bool, shape (D,)
        Whether the branches from all Hopf points were followed to their ends. Where the fold was found from that of the
        nominal design they were not: there may be a second one, lower.
    status : tuple of D str
        How each fold was found; where there is none, how the branches go on, as evidence.
    """

    parameter: str
    points: dict[str, Array]
    fold: Array
    fold_omega: Array
    fold_gradient: dict[str, Array]
    hopf: Array
    hopf_omega: Array
    hopf_gradient: dict[str, Array]
    failed: NDArray[np.bool_]
    complete: NDArray[np.bool_]
    status: tuple[str, ...]

    __repr__ = brief

    @property
    def critical(self) -> Array:
        """The smaller of fold and Hopf point, shape (D,), unit of the parameter; NaN also where it is not known."""
        return np.where(self.failed, np.nan, np.fmin(self.fold, self.hopf))


@door(system=System, points=Mapping, parameter=str)
def critical_speeds_of(
    system: System,
    points: Mapping[str, ArrayLike],
    *,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
) -> CriticalDesigns:
    """Find the first Hopf point and the fold below it of many designs, with their gradients.

    Where the system is linear between the switchings of piecewise-linear laws, all designs are solved for together, in
    closed form: the folds are those of exact cycles, without harmonics that are left out, and the search begins at the
    fold of the system's own parameter values. Where that fails, the branches of the design are followed from its Hopf
    points. Designs for which that fails, too, and any other system, are done one at a time by `critical_speeds`.

    Parameters
    ----------
    system : System
        Its own parameter values are the nominal design, and those of every design in all parameters that the points
        leave out.
    points : mapping from name to array_like, shape (D,), unit of the parameter
        Parameter values of the designs; a single number serves all of them.
    parameter : str
        Whose critical values are looked for.
    interval : (float, float), optional, unit of the parameter
        Where to look; twice the parameter's value (at least 1) to either side, within its bounds, where left out.

    Returns
    -------
    CriticalDesigns

    Raises
    ------
    ModelError
        For wrong names or values.
    ConvergenceError
        When a system that is linear between switchings has, at its own parameter values, no Hopf point in the interval,
        or no contact that its cycles touch.

    Examples
    --------
    >>> import hbbogie as hb
    >>> bogie = hb.load_problem("yang1995").bogie()
    >>> found = hb.critical.critical_speeds_of(bogie, {"lam": [0.045, 0.05, 0.055]})
    >>> found.fold.round(6)
    array([93.622471, 88.764113, 84.541414])
    >>> bool(found.fold_gradient["lam"][1] < 0)
    True
    """
    try:
        given = {name: np.atleast_1d(np.asarray(values, dtype=float)) for name, values in points.items()}
    except (TypeError, ValueError) as error:
        raise ModelError(
            f"critical_speeds_of: the points are no numbers ({error}); give one for each design."
        ) from None
    if parameter in given:
        raise ModelError(f"critical_speeds_of: {parameter!r} is what is looked for; leave it out of the points.")
    if not given:
        raise ModelError("critical_speeds_of: no points are given; give values, such as {'lam': [0.04, 0.05]}.")
    sizes = {name: values.shape for name, values in given.items()}
    try:
        designs = dict(zip(given, map(np.array, np.broadcast_arrays(*given.values())), strict=True))
    except ValueError:
        designs = {}
    if not designs or any(values.ndim != 1 or not len(values) for values in designs.values()):
        raise ModelError(f"critical_speeds_of: the points have the shapes {sizes}; give one number for each design.")
    for name, values in designs.items():
        for value in (values.min(), values.max()):
            system.with_parameters(**{name: value})  # raises where it is unknown or out of bounds
    D, names = len(next(iter(designs.values()))), system.parameter_names
    p = np.tile(system.vector(), (D, 1))
    for name, values in designs.items():
        p[:, names.index(name)] = values
    span = interval or default_reach(system, parameter)
    if not is_switched_linear(system):
        check_interval(system, parameter, span)
        return _one_by_one(system, designs, parameter, span)
    found = critical_values(system, p, parameter, span)
    hopf = found.hopf

    def by_name(gradient: Array) -> dict[str, Array]:
        return {name: gradient[:, i] for i, name in enumerate(names) if name != parameter}

    known = CriticalDesigns(
        parameter, designs, found.fold, found.fold_omega, by_name(found.fold_gradient), hopf.value, hopf.omega,
        by_name(hopf.gradient), found.failed, found.complete, found.status,
    )  # fmt: skip
    lost = np.flatnonzero(known.failed)
    if not len(lost):
        return known
    return _filled(known, lost, _one_by_one(system, {n: v[lost] for n, v in designs.items()}, parameter, span))


def _filled(known: CriticalDesigns, lost: NDArray[np.int_], others: CriticalDesigns) -> CriticalDesigns:
    """Return critical values with those of some designs, for which the search in closed form failed, from another."""
    for name in ("fold", "fold_omega", "hopf", "hopf_omega", "failed", "complete"):
        getattr(known, name)[lost] = getattr(others, name)
    for kind in ("fold_gradient", "hopf_gradient"):
        for name, slopes in getattr(others, kind).items():
            getattr(known, kind)[name][lost] = slopes
    status = list(known.status)
    for d, said in zip(lost, others.status, strict=True):
        status[d] = f"{status[d]}; one by one: {said}"
    return replace(known, status=tuple(status))


def _one_by_one(
    system: System, designs: dict[str, Array], parameter: str, span: tuple[float, float]
) -> CriticalDesigns:
    """Return the critical values of designs that are searched by `critical_speeds`."""
    D, others = len(next(iter(designs.values()))), [n for n in system.parameter_names if n != parameter]
    values = {kind: np.full((2, D), np.nan) for kind in ("fold", "hopf")}
    slopes = {kind: {name: np.full(D, np.nan) for name in others} for kind in values}
    complete, status = np.zeros(D, dtype=bool), []
    for d in range(D):
        one = system.with_parameters(**{name: float(column[d]) for name, column in designs.items()})
        found = critical_speeds(one, parameter, span)
        top = next((c.value for c in found if c.kind == "hopf"), np.inf)
        for kind in values:
            c = next((c for c in found if c.kind == kind and c.value <= top), None)
            if c is not None:
                values[kind][:, d] = c.value, c.omega
                for name, slope in c.gradient.items():
                    slopes[kind][name][d] = slope
        complete[d] = found.complete
        status.append("; ".join(["no fold"] * bool(np.isnan(values["fold"][0, d])) + [*found.evidence]))
    (fold, fold_omega), (hopf, hopf_omega) = values.values()
    return CriticalDesigns(
        parameter, designs, fold, fold_omega, slopes["fold"], hopf, hopf_omega, slopes["hopf"],
        np.isnan(fold) & ~complete, complete, tuple(status),
    )  # fmt: skip
