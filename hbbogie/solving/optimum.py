"""Optimal cycles: a nonlinear program over a cycle and parameters, solved by IPOPT."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.expressions import CycleFunction, CycleLimit
from hbbogie.solving.program import nonlinear_program

Array = NDArray[np.float64]
FARTHEST = 100.0  # largest value of a free parameter, in units of its first value
REACH, SMALLEST, BOXES = 0.2, 1e-4, 60  # of boxes: size and smallest size, in units of the scales; number
ACTIVE = 1e-6  # scaled multiplier above which a limit counts as active


@dataclass(frozen=True, eq=False)
class Optimum:
    """A cycle at which an objective is smallest among its neighbours.

    Attributes
    ----------
    orbit : Orbit
    value : float, unit of the objective
    gradient : dict of float, unit of the objective per unit of the parameter
        Derivative of the value with respect to every parameter that is not free.
    multipliers : tuple of ndarray, unit of the objective per unit of the limited quantity
        For every limit, one multiplier for each of its entries: the decrease of the value per unit by which the limited
        quantity may become larger (negative for an active lower limit).
    active : tuple of str
        Active limits and bounds, by their number or name.
    residual : float
        Largest scaled residual of the equations.
    iterations : int
    status : str
    """

    orbit: Orbit
    value: float
    gradient: dict[str, float]
    multipliers: tuple[Array, ...]
    active: tuple[str, ...]
    residual: float
    iterations: int
    status: str

    __repr__ = brief


def minimise(
    equations: Equations,
    guess: Orbit,
    free: Sequence[str],
    objective: CycleFunction,
    subject_to: Sequence[CycleLimit] = (),
    *,
    reach: float = REACH,
    tolerance: float = 1e-9,
    **fixed: float,
) -> Optimum:
    """Find the cycle near a guess at which an objective is smallest, over some parameters.

    Parameters
    ----------
    equations : Equations
    guess : Orbit
        The cycle, and the values of the free parameters, at which the search begins.
    free : sequence of str
        Parameters that are unknowns, within their bounds.
    objective : callable, Cycle -> scalar expression
    subject_to : sequence of (callable, lower, upper)
        Cycle -> expression, scalar or vector, and its limits; None means no limit.
    reach : float
        Largest distance of one solution from the last point, in units of the scales. If it reaches this distance, the
        search continues in a new box.
    tolerance : float
        Largest scaled residual accepted.
    **fixed : float
        Values of other parameters.

    Raises
    ------
    ConvergenceError
        When IPOPT does not converge. The message gives its status.
    ModelError
        For unknown names, or limits that contradict each other.

    Notes
    -----
    The equations, the objective and the limits, with their exact first and second derivatives (eq-optimum), form a
    nonlinear program in the scaled unknowns. Functions are built once for the same callables. In a loop, therefore,
    pass named functions and not a new lambda in every iteration.
    """
    system = equations.system
    _check(free, objective, subject_to, fixed)
    places = tuple(system.parameter_names.index(system.parameter(name).name) for name in free)
    p = system.vector(**fixed)
    for i in places:
        p[i] = guess.parameters.get(system.parameter_names[i], p[i])
    functions = (objective, *(quantity for quantity, _, _ in subject_to))
    program = equations.once(("optimum", places, functions), lambda: nonlinear_program(equations, places, functions))
    m, y = equations.size, np.append(equations.encode(guess), p[list(places)])
    _, df, _, dg = (np.atleast_2d(a.full()) for a in program.quantities(y[:m], p))
    columns = [*range(m), *(m + i for i in places)]
    size = np.where(p[list(places)] == 0, 1.0, np.abs(p[list(places)]))
    scale = np.append(equations.scale, size)
    f_scale = 1 / max(float(np.abs(df[0, columns] * scale).max()), 1e-300)
    rows = _row_scales(np.abs(dg[:, columns] * scale), program.sizes)
    limits = [np.append(np.zeros(m), side / rows) for side in _limits(subject_to, program.sizes)]
    ends = np.array([system.parameters[i].bounds for i in places]).T
    lower = np.append(equations.lower, np.maximum(ends[0], y[m:] - FARTHEST * size)) / scale
    upper = np.append(equations.upper, np.minimum(ends[1], y[m:] + FARTHEST * size)) / scale
    theta = np.concatenate([p, scale, equations.residual_scale, [f_scale], rows])
    x, result, count, done = _search(program.solver, y / scale, theta, (lower, upper), (limits[0], limits[1]), reach)
    y = x * scale
    p[list(places)] = y[m:]
    F = equations.residual(y[:m], p).full().ravel()
    residual = float(np.abs(F / equations.residual_scale).max())
    orbit = equations.decode(y[:m], p, done, F)
    if result is None or residual > tolerance:
        raise ConvergenceError(
            f"no optimum found ({equations.method}; {done}, scaled residual {residual:.1e}). What to try: begin with a "
            "cycle of the equations that meets the limits, from find_cycles or trace, or relax the limits.",
            orbit,
            {"return_status": done, "iterations": count},
        )
    lam_g, lam_x = result["lam_g"].full().ravel(), result["lam_x"].full().ravel()
    f, df, _, dg = (np.atleast_2d(a.full()) for a in program.quantities(y[:m], p))
    weights = lam_g[:m] / equations.residual_scale / f_scale, lam_g[m:] / rows / f_scale
    slopes = df[0, m:] + equations.sensitivity()(y[:m], p, weights[0]).full().ravel()
    slopes = slopes + (weights[1] @ dg[:, m:] if len(rows) else 0.0)
    gradient = {n: float(slopes[i]) for i, n in enumerate(system.parameter_names) if i not in places}
    last = np.cumsum(program.sizes, dtype=int)  # excess over each limit
    parts, scaled = (np.split(values, last)[:-1] for values in (weights[1], lam_g[m:]))
    held = [f"limit {i + 1}" for i, part in enumerate(scaled) if np.abs(part).max() > ACTIVE]
    labels = (*equations.unknowns, *free)
    held += [f"bound of {name}" for name, value in zip(labels, lam_x, strict=True) if abs(value) > ACTIVE]
    return Optimum(orbit, float(f[0, 0]), gradient, tuple(parts), tuple(held), residual, count, done)


def _check(free: Sequence[str], objective: Any, subject_to: Any, fixed: Mapping[str, float]) -> None:
    """Raise `ModelError` where an argument of `minimise` is not acceptable."""
    if not free:
        raise ModelError("minimise: free names no parameter; to find a cycle at given parameters, leave minimise out.")
    if twice := [name for name in free if list(free).count(name) > 1 or name in fixed]:
        raise ModelError(f"minimise: parameter {twice[0]!r} is named twice among free and fixed ones; leave one out.")
    example = "lambda cycle: cycle.parameter('V')"
    if not callable(objective):
        raise ModelError(f"minimise: the objective is {objective!r}; give a function of the cycle, such as {example}.")
    for i, limit in enumerate(subject_to if isinstance(subject_to, Sequence) else [subject_to]):
        whole = isinstance(limit, Sequence) and len(limit) == 3 and callable(limit[0])
        if not whole or not all(side is None or isinstance(side, Real) for side in limit[1:]):
            raise ModelError(
                f"subject_to: limit {i + 1} is {limit!r}; give ({example}, lower, upper), None for no limit."
            )


def _search(
    solver: ca.Function, x: Array, theta: Array, bounds: tuple[Array, Array], limits: tuple[Array, Array], reach: float
) -> tuple[Array, dict[str, ca.DM] | None, int, str]:
    """Find the optimum in successive boxes about the last point, because longer steps may lead astray.

    Returns
    -------
    x, result, iterations, status
        The last point, and the result of IPOPT there, None if it is not an optimum.
    """
    longest, count = reach, 0
    for boxes in range(1, BOXES + 1):
        low, high = np.maximum(bounds[0], x - reach), np.minimum(bounds[1], x + reach)
        result = solver(x0=np.clip(x, low, high), p=theta, lbx=low, ubx=high, lbg=limits[0], ubg=limits[1])
        statistics = solver.stats()
        count += statistics["iter_count"]
        status = f"IPOPT: {statistics['return_status']} after {count} iterations in {boxes} box(es)"
        if not statistics["success"]:
            there = result["x"].full().ravel()
            infeasible = "Infeasible" in statistics["return_status"]
            if infeasible and np.isfinite(reach) and np.abs(there - x).max() > 0.9 * reach:
                x = there  # come as close to the limits as the box allows
                continue
            reach /= 4
            if reach < SMALLEST or np.isinf(reach):
                break
            continue
        x, lam = result["x"].full().ravel(), result["lam_x"].full().ravel()
        inside = (np.abs(lam) <= ACTIVE) | (lam > 0) & (high == bounds[1]) | (lam < 0) & (low == bounds[0])
        if inside.all():
            return x, result, count, status
        reach = min(2 * reach, longest)
    return x, None, count, status


def _row_scales(slopes: Array, sizes: Sequence[int]) -> Array:
    """Return a typical change of every limited quantity: for each limit, the largest of its entries."""
    ends = np.cumsum(sizes, dtype=int)
    largest = [slopes[end - size : end].max() for end, size in zip(ends, sizes, strict=True)]
    return np.repeat([value if value > 0 else 1.0 for value in largest], sizes)


def _limits(subject_to: Sequence[CycleLimit], sizes: Sequence[int]) -> tuple[Array, Array]:
    """Return lower and upper limits of all entries; raise `ModelError` when they contradict each other."""
    low, high = [], []
    for i, ((_, lower, upper), size) in enumerate(zip(subject_to, sizes, strict=True)):
        a, b = -np.inf if lower is None else float(lower), np.inf if upper is None else float(upper)
        if not a <= b:
            raise ModelError(f"subject_to: limit {i + 1} has lower {a:g} and upper {b:g}; give lower <= upper.")
        low += [a] * size
        high += [b] * size
    return np.array(low), np.array(high)
