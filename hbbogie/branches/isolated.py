"""Branches that no Hopf point leads to: a search from random cycles that excludes known branches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.continuation import trace
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.errors import ModelError, door
from hbbogie.methods.equations import Equations
from hbbogie.model.ranges import check_interval
from hbbogie.results import Branch, Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.periodic import FourierSeries
from hbbogie.solving.expressions import Cycle, CycleLimit
from hbbogie.solving.optimum import minimise

Array = NDArray[np.float64]
SIZES = (0.05, 10.0)  # amplitudes of random cycles, in units of the amplitude scale
AWAY = 0.05  # distance to be kept from what is known, in units of the scales
KEPT_OUT = 40  # points of each known branch that are kept out


@door(equations=Equations, parameter=str)
def isolated_branches(
    equations: Equations,
    parameter: str,
    interval: tuple[float, float],
    known: Sequence[Branch] = (),
    *,
    attempts: int = 20,
    seed: int = 0,
    **options: Any,
) -> list[Branch]:
    """Search for branches of cycles that are not known, such as isolas.

    From random amplitudes and values of the parameter along the least damped mode the smallest and the largest value of
    the parameter are sought over the cycles, as nonlinear programs in which known cycles are kept out by a distance
    (deflation). What is found is traced, and is known from then on.

    Parameters
    ----------
    equations : Equations
    parameter : str
    interval : (float, float), unit of the parameter
    known : sequence of Branch
        Branches already traced in this interval.
    attempts : int
        Random starts. Finding nothing in them proves nothing.
    seed : int
        Of the random starts.
    **options
        Further options of `trace`.

    Returns
    -------
    list of Branch
        In the order found.

    Raises
    ------
    ModelError
        For an unknown parameter, an empty interval, or no attempt.
    """
    system = equations.system
    lo, hi = check_interval(system, parameter, interval)
    if attempts < 1:
        raise ModelError(f"isolated_branches: attempts={attempts}; give a whole number from 1.")
    random = np.random.default_rng(seed)
    found: list[Branch] = []
    for attempt in range(attempts):
        guess = _random_cycle(equations, parameter, float(random.uniform(lo, hi)), random)
        limits: list[CycleLimit] = [(_value(parameter), lo, hi)]
        limits += [(_distance(equations, branch, hi - lo), AWAY**2, None) for branch in (*known, *found)]
        sign = 1 if attempt % 2 == 0 else -1
        try:
            best = minimise(equations, guess, [parameter], _value(parameter, sign), limits, reach=np.inf)
            branch = trace(equations, best.orbit, parameter, (lo, hi), **options)
        except ConvergenceError:
            continue
        if not any(_meets(equations, branch, other, hi - lo) for other in (*known, *found)):
            found.append(branch)
    return found


def _random_cycle(equations: Equations, parameter: str, value: float, random: np.random.Generator) -> Orbit:
    """Return a cycle of random size along the least damped oscillating mode at a value of the parameter."""
    system, line = equations.system, Linearisation(equations.system, parameter)
    _, eigenvalues, vectors = line.pairs(value)
    if not len(eigenvalues):
        raise ModelError(f"system {system.name!r} has no oscillating mode at {parameter} = {value:g} to begin with.")
    mode = vectors[: system.n, 0] / np.abs(vectors[: system.n, 0]).max()
    size = float(equations.scale[0]) * float(np.exp(random.uniform(*np.log(SIZES))))
    c = np.array([line.equilibrium(value), size * mode.real, -size * mode.imag])
    values = dict(zip(system.parameter_names, map(float, line.parameters(value)), strict=True))
    units = tuple(x.unit for x in system.coordinates)
    return Orbit(
        system=system.name,
        coordinates=system.coordinate_names,
        naming=system.naming,
        units=units,
        motion=FourierSeries(c),
        omega=float(eigenvalues[0].imag),
        parameters=values,
        method="random",
    )


def _value(parameter: str, sign: int = 1) -> Callable[[Cycle], ca.MX]:
    return lambda cycle: sign * cycle.parameter(parameter)


def _points(equations: Equations, branch: Branch, width: float) -> Array:
    """Return points of a branch, shape (k, 3): frequency, size of the motion and parameter, scaled."""
    some = [branch.orbits[i] for i in np.unique(np.linspace(0, len(branch) - 1, KEPT_OUT).astype(int))]
    size = [np.linalg.norm(o.coefficients[1:]) / equations.scale[0] for o in some]
    omega = [o.omega / equations.scale[-1] for o in some]
    return np.column_stack([omega, size, [4 * o.parameters[branch.parameter] / width for o in some]])


def _distance(equations: Equations, branch: Branch, width: float) -> Callable[[Cycle], ca.MX]:
    """Return the squared distances of a cycle from points of a branch, as a quantity."""
    points = _points(equations, branch, width)

    def quantity(cycle: Cycle) -> ca.MX:
        size = ca.norm_2(ca.vec(cycle.coefficients[1:, :])) / equations.scale[0]
        here = ca.vertcat(cycle.omega / equations.scale[-1], size, 4 * cycle.parameter(branch.parameter) / width)
        return ca.vertcat(*(ca.sumsqr(here - point) for point in points))

    return quantity


def _meets(equations: Equations, branch: Branch, other: Branch, width: float) -> bool:
    """Tell whether two branches have a point in common, by the distance from the other's polygon."""
    a, b = _points(equations, branch, width), _points(equations, other, width)
    if len(b) < 2:
        return bool(np.linalg.norm(a - b, axis=1).min() < 1e-3)
    start, along = b[:-1], np.diff(b, axis=0)
    share = np.einsum("ijk,jk->ij", a[:, None] - start, along) / np.maximum((along**2).sum(axis=1), 1e-300)
    foot = start + np.clip(share, 0, 1)[..., None] * along
    return bool(np.linalg.norm(a[:, None] - foot, axis=2).min(axis=1).min() < 0.2 * AWAY)
