"""Values of a parameter at which the cycles of a branch meet a limit, with their gradients in all parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door, named, positive
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.results import Branch, LimitPoint, Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.measures import MEASURES, measured
from hbbogie.solving.newton import Conditions, Problem
from hbbogie.units import behind

Array = NDArray[np.float64]
ITERATIONS = 25
FARTHEST = 0.2  # longest step of an unknown, in units of its scale
LEVEL = 1e-10  # reciprocal condition of the equations below which the quantity has its extremum at the limit


@door(equations=Equations, branch=Branch, of=str)
def limit_points(
    equations: Equations,
    branch: Branch,
    of: str,
    limit: float,
    quantity: str = "rms",
    *,
    tolerance: float = 1e-9,
) -> list[LimitPoint]:
    """Return where cycles of a branch meet a limit, such as the speeds at which an rms acceleration is allowed no more.

    Between two neighbours on the branch, one below and one above the limit, Newton's method solves the equations of the
    cycle and "quantity = limit" for the cycle and the parameter. The gradient follows from the adjoint of the same
    equations (eq-limit-gradient), without finite differences.

    Parameters
    ----------
    equations : Equations
        With which the cycles are solved for; those of the branch, or with more harmonics.
    branch : Branch
        Dense enough that the quantity meets the limit at most once between neighbours.
    of : str
        Name of a coordinate or output.
    limit : float, unit of the quantity
        Above 0.
    quantity : {"rms", "peak", "first harmonic"}
    tolerance : float
        Largest scaled residual.

    Returns
    -------
    list of LimitPoint
        In the order of the branch. Empty where all its cycles lie on one side.

    Raises
    ------
    ModelError
        For wrong names, or a limit that is no positive number.
    ConvergenceError
        Where a point is lost, the quantity has its extremum at the limit, or the peak is at a kink.

    References
    ----------
    Theory page, eq-limit-gradient.
    """
    system = equations.system
    value = check_limit(system, of, limit, quantity)
    if equations.phase is None or not len(branch) or branch.parameter not in system.parameter_names:
        raise ModelError("limit_points: give equations of cycles, and a branch of cycles over one of their parameters.")
    sizes = np.array([_measure(o, of, quantity) for o in branch.orbits]) - value
    places = np.flatnonzero((sizes[:-1] > 0) != (sizes[1:] > 0))
    found = []
    for i in places:
        share = sizes[i] / (sizes[i] - sizes[i + 1])
        pair = branch.orbits[i], branch.orbits[i + 1]
        found.append(_solved(equations, branch.parameter, pair, share, of, value, quantity, tolerance))
    return found


def check_limit(system: System, of: str, limit: float, quantity: str) -> float:
    """Return the limit; raise `ModelError` for wrong names, or a limit that is no positive number."""
    named("limit", "quantity", quantity, MEASURES)
    named(f"system {system.name!r}", "coordinate or output", of, (*system.coordinate_names, *system.output_names))
    return positive(f"limit of {of}", limit, system.naming.units.get(of, "1"))


def _measure(o: Orbit, of: str, quantity: str) -> float:
    return {"rms": o.rms, "peak": o.amplitude, "first harmonic": o.first_harmonic}[quantity](of)


def _solved(
    equations: Equations,
    parameter: str,
    pair: tuple[Orbit, Orbit],
    share: float,
    of: str,
    limit: float,
    quantity: str,
    tolerance: float,
) -> LimitPoint:
    """Solve for the cycle between two neighbours that meets the limit, and for its gradient."""
    equations = equations.phased(pair[0])
    system, m = equations.system, equations.size
    place = system.parameter_names.index(parameter)
    columns = [*range(m), m + place]
    ends = [np.append(equations.encode(o), o.parameters[parameter]) for o in pair]
    y = (1 - share) * ends[0] + share * ends[1]
    p = system.vector(**{parameter: y[-1]})
    problem = Problem(equations, Conditions((place,)), p)
    where = f"{quantity} of {of} = {limit:g} near {parameter} = {y[-1]:.6g}"
    error, A, d = np.inf, np.empty(0), np.empty(0)
    for _ in range(ITERATIONS):
        F, J = problem.evaluate(y)
        cycle, p = problem.orbit(y, ""), problem.parameters(y)
        size, d = measured(equations, quantity, of, cycle, y[:m], p)
        A = np.vstack([J / problem.row_scale[:, None], d[columns] / limit]) * problem.scale
        G = np.append(F / problem.row_scale, size / limit - 1)
        error = float(np.abs(G).max())
        if error <= tolerance or not np.isfinite(error):
            break
        step = np.linalg.lstsq(A, -G, rcond=None)[0]
        y = y + problem.scale * step * min(1.0, FARTHEST / max(float(np.abs(step).max()), 1e-300))
    if not error <= tolerance:
        raise ConvergenceError(f"{where} was not solved for; residual {error:.1e}. Follow the branch in smaller steps.")
    if np.linalg.cond(A) > 1 / LEVEL:
        raise ConvergenceError(f"{where}: the quantity has an extremum there, and the value no derivative.")
    adjoint = np.linalg.solve(A.T, np.append(np.zeros(m), problem.scale[-1]))
    slopes = equations.sensitivity()(y[:m], p, adjoint[:m] / problem.row_scale).full().ravel()
    slopes = -(slopes + adjoint[m] / limit * d[m:])
    names = system.parameter_names
    unit = system.naming.units.get(of, "1")
    shown = f"{limit:g}{behind(unit)}"
    return LimitPoint(
        kind="limit",
        parameter=parameter,
        value=float(y[-1]),
        extremum="",
        omega=float(equations.frequency(y[:m])),
        gradient={n: float(g) for i, (n, g) in enumerate(zip(names, slopes, strict=True)) if i != place},
        orbit=problem.orbit(y, f"{quantity} of {of} = {shown}"),
        residual=error,
        curvature=float("nan"),
        status=f"the {quantity} of {of} meets {shown}, by {equations.method}",
        of=of,
        quantity=quantity,
        limit=limit,
        per_limit=float(adjoint[m] / limit),
    )
