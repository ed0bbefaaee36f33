"""Critical values of a parameter: Hopf points and folds, each with its gradient in all parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import issparse

from hbbogie.branches.closed_form import exact_fold
from hbbogie.branches.collocated import collocated_fold
from hbbogie.branches.continuation import balanced_trace, trace
from hbbogie.collocation.method import CollocationEquations
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door
from hbbogie.exact.method import ExactEquations
from hbbogie.methods.equations import Equations
from hbbogie.results import Critical, Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.linear import Factors, Matrix, scaled, with_row
from hbbogie.solving.newton import Conditions, Problem
from hbbogie.solving.solvers import solve

Array = NDArray[np.float64]
ITERATIONS = 25
FARTHEST = 0.2  # longest step of an unknown, in units of its scale: a guess near a fold is near it
FLAT = 1e-8  # curvature of the parameter along the cycles, in units of its value, below which there is no extremum
BESIDE, REACH = (0.003, 0.02), 3.0  # shares of the value by which a cycle is beside a fold; how much farther to trace
SHORTEST = 0.02  # share of the way to new parameters at which the walk gives up


@door(equations=(Equations, ExactEquations, CollocationEquations), guess=(Orbit, SpecialPoint), parameter=str)
def fold(
    equations: Equations | ExactEquations | CollocationEquations,
    guess: Orbit | SpecialPoint,
    parameter: str | None = None,
    *,
    search: bool = True,
    tolerance: float = 1e-10,
) -> Critical:
    """Locate a fold, the extremum of a parameter over the cycles, with the gradient of its value.

    Newton's method on the conditions of optimality of the nonlinear program "extremum of the parameter subject to
    the equations" (eq-fold-optimality), with exact second derivatives. The multipliers are the gradient
    (eq-fold-gradient). Where that fails, the branch through a cycle beside the guess is traced, then those from the
    Hopf points about the guess's value; where that finds none, the parameters are gone to in steps from those of the
    guess.

    Parameters
    ----------
    equations : Equations, or those of `hbbogie.exact.Exact` or `hbbogie.collocation.Collocation`
        With those of `Exact` the conditions of a fold are solved in closed form from the guess. With those of
        `Collocation` the branch is followed from the guess. ``search`` and ``tolerance`` are not used with either.
    guess : Orbit or SpecialPoint
        Near the fold, such as one of ``branch.folds()``.
    parameter : str, optional
        By default that of the special point.
    search : bool
        Whether to go on in steps, and by tracing, where Newton's method fails from the guess.
    tolerance : float
        Largest scaled residual of the equations and of the conditions of optimality.

    Returns
    -------
    Critical

    Raises
    ------
    ConvergenceError
        When there is no fold near the guess.
    ModelError
        For an unknown parameter, or equations of equilibria.
    """
    system = equations.system
    if parameter is None and not isinstance(guess, SpecialPoint):
        raise ModelError("fold: the guess is an orbit, which knows no parameter to vary; give its name, such as 'V'.")
    parameter = system.parameter(guess.parameter if parameter is None else parameter).name  # type: ignore[union-attr]
    if isinstance(equations, CollocationEquations):
        return collocated_fold(equations, guess, parameter)
    if isinstance(equations, ExactEquations):
        return exact_fold(equations, guess.orbit if isinstance(guess, SpecialPoint) else guess, parameter)
    place = system.parameter_names.index(parameter)
    if equations.phase is None:
        raise ModelError("fold: the equations are those of equilibria; ask for at least one harmonic.")
    orbit = guess.orbit if isinstance(guess, SpecialPoint) else guess
    equations = equations.phased(orbit)
    found = _newton(equations, place, orbit, system.vector(), tolerance)
    if search and not found.converged:
        found = _beside(equations, place, orbit, tolerance) or _by_tracing(equations, place, orbit, tolerance) or found
    if search and not found.converged and set(orbit.parameters) == set(system.parameter_names):
        found = _walk(equations, place, orbit, tolerance) or found
    if not found.converged:
        raise ConvergenceError(
            f"no fold found near the guess ({equations.method}; {found.why}). What to try: locate it first with trace, "
            "and start from branch.folds().",
            found.problem.orbit(found.y, "did not converge"),
            {"residual": found.error},
        )
    return _critical(found, parameter)


def located_fold(special: SpecialPoint, why: str) -> Critical:
    """Return a fold as it was located along its branch, and why it has no gradient."""
    orbit = special.orbit
    return Critical(
        kind="fold",
        parameter=special.parameter,
        value=special.value,
        extremum=special.extremum,
        omega=special.omega,
        gradient={},
        orbit=orbit,
        residual=orbit.residual,
        curvature=float("nan"),
        status=f"located along the branch, {special.status}; no gradient: {why}",
    )


@dataclass(frozen=True, eq=False)
class _Solved:
    """How Newton's method on the conditions of optimality ended."""

    problem: Problem
    y: Array
    multipliers: Array
    curvature: float
    error: float
    converged: bool
    why: str


def _newton(equations: Equations, place: int, orbit: Orbit, p: Array, tolerance: float) -> _Solved:
    """Solve F = 0 and the conditions of optimality at the parameters p, from an orbit near the fold.

    At a fold the tangent t of the curve F = 0 has no component in the parameter. The derivative of that component is
    W t, with W the second derivative of multipliers . F (eq-fold-step). A step goes onto the curve, and along t to
    where the component vanishes.
    """
    name = equations.system.parameter_names[place]
    p = p.copy()
    p[place] = orbit.parameters.get(name, p[place])
    problem = Problem(equations, Conditions((place,)), p)
    y = np.append(equations.encode(orbit), p[place])
    second = equations.hessian_times((place,))
    F, J = _scaled(problem, y)
    t = _tangent(J)
    multipliers, why, error, curvature = np.zeros(len(F)), f"not converged after {ITERATIONS} iterations", np.inf, 0.0
    for iteration in range(ITERATIONS):
        try:
            along, row, onto = _inverted(J, t, F)
        except np.linalg.LinAlgError:
            why = "the conditions of optimality are singular"
            break
        L, multipliers = row[-1] * t, -row[:-1]
        t = along / np.linalg.norm(along)
        W_t = _second_along(problem, second, y, multipliers, t)
        curvature, error = float(t @ W_t), float(max(np.abs(F).max(), np.abs(L).max()))
        if error <= tolerance and iteration:  # one step at least: the parameter is then good to round-off
            why = f"found in {iteration} iterations"
            break
        if time_is_over():
            why = "the time limit was reached"
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            step = onto - (t[-1] + W_t @ onto) / curvature * t
        y = y + min(1.0, FARTHEST / max(float(np.abs(step).max()), 1e-300)) * problem.scale * step
        if not np.isfinite(y).all():
            why = "the iteration left all bounds"
            break
        F, J = _scaled(problem, y)
    converged, active = error <= tolerance, problem.violated(y)
    curvature *= float(problem.scale[-1])
    if active:
        converged, why = False, f"{why}; {', '.join(map(str, active))}"
    elif converged and abs(curvature) <= FLAT * abs(float(problem.scale[-1])):
        converged, why = False, f"it led to cycles along which {name} does not vary, as those of a linear system"
    return _Solved(problem, y, multipliers, curvature, error, converged, why)


def _walk(equations: Equations, place: int, orbit: Orbit, tolerance: float) -> _Solved | None:
    """Go from the guess's parameters to those asked for in steps, as long as Newton's method needs; None if lost."""
    goal = equations.system.vector()
    start = np.array([orbit.parameters[name] for name in equations.system.parameter_names])
    done, stride = 0.0, 0.5
    while stride > SHORTEST:
        share = min(done + stride, 1.0)
        found = _newton(equations, place, orbit, start + share * (goal - start), tolerance)
        if not found.converged:
            stride /= 2
            continue
        if share == 1.0:
            return found
        done, orbit, stride = share, found.problem.orbit(found.y, ""), 1.5 * stride
    return None


def _beside(equations: Equations, place: int, orbit: Orbit, tolerance: float) -> _Solved | None:
    """Trace the branch through a cycle at a value beside the guess's; return the fold nearest in value."""
    name = equations.system.parameter_names[place]
    if name not in orbit.parameters:
        return None
    value, size = orbit.parameters[name], max(abs(orbit.parameters[name]), 0.1)
    for share in (sign * share for share in BESIDE for sign in (1, -1)):
        at: dict[str, Any] = {name: value + share * size}
        span = value - REACH * abs(share) * size, value + REACH * abs(share) * size
        try:
            cycle = solve(equations, orbit, method="newton", **at)
            branch = balanced_trace(equations, cycle, name, span, families=False, stability=False, doubts=False)
        except (ConvergenceError, ModelError):  # no cycle is there, or no such value
            continue
        for special in sorted(branch.folds(), key=lambda special: abs(special.value - value)):
            found = _newton(equations, place, special.orbit, equations.system.vector(), tolerance)
            if found.converged:
                return found
    return None


def _by_tracing(equations: Equations, place: int, orbit: Orbit, tolerance: float) -> _Solved | None:
    """Trace the branches from the Hopf points about the guess's value; return the fold nearest in frequency."""
    name, best = equations.system.parameter_names[place], None
    value, (low, high) = orbit.parameters.get(name, 0.0), equations.system.parameter(name).bounds
    reach = max(1.2 * abs(value), 0.5)
    span = max(value - reach, low), min(value + reach, high)
    for hopf in hopf_points(equations.system, name, span):
        try:
            branch = trace(equations, hopf, name, span, families=False, stability=False)
        except ConvergenceError:
            continue
        for special in branch.folds():
            found = _newton(equations, place, special.orbit, equations.system.vector(), tolerance)
            nearer = best is None or abs(special.omega - orbit.omega) < abs(best.y[-2] - orbit.omega)
            if found.converged and nearer:
                best = found
    return best


def _scaled(problem: Problem, y: Array) -> tuple[Array, Matrix]:
    """Return scaled residual and its Jacobian in scaled unknowns."""
    F, J = problem.linearise(y)
    return F / problem.row_scale, scaled(J, problem.row_scale, problem.scale)


def _tangent(J: Matrix) -> Array:
    """Return the unit vector that a matrix with one more column than rows makes zero."""
    if not issparse(J):
        return np.asarray(np.linalg.qr(J.T, mode="complete")[0][:, -1])
    t = _inverted(J, np.random.default_rng(0).standard_normal(J.shape[1]), np.zeros(J.shape[0]))[0]
    return t / np.linalg.norm(t)


def _inverted(J: Matrix, t: Array, F: Array) -> tuple[Array, Array, Array]:
    """Return of the inverse of [J; t] the last column, the last row, and minus its product with [F; 0].

    The column is along the tangent. The row has the multipliers, and last what they leave, along t.

    Raises
    ------
    numpy.linalg.LinAlgError
        If that matrix is singular.
    """
    matrix = with_row(J, t)
    if not issparse(matrix):
        inverse = np.linalg.inv(matrix)
        return inverse[:, -1], inverse[-1], -inverse[:, :-1] @ F
    factors, last = Factors(matrix), np.append(np.zeros(len(F)), 1.0)
    return factors.solve(last), factors.solve(last, "T"), -factors.solve(np.append(F, 0.0))


def _second_along(problem: Problem, second: ca.Function, y: Array, multipliers: Array, t: Array) -> Array:
    """Return the scaled second derivative of multipliers . F times a direction."""
    z, p = y[: problem.equations.size], problem.parameters(y)
    W_t = second(z, p, multipliers / problem.row_scale, problem.scale * t).full().ravel()
    return np.asarray(W_t * problem.scale)


def _critical(found: _Solved, parameter: str) -> Critical:
    problem, y = found.problem, found.y
    equations, system = problem.equations, problem.equations.system
    m, p, place = equations.size, problem.parameters(y), problem.free[0]
    slopes = equations.sensitivity()(y[:m], p, found.multipliers / problem.row_scale).full().ravel()
    slopes = slopes * problem.scale[-1]  # the objective was the scaled parameter
    gradient = {n: float(g) for i, (n, g) in enumerate(zip(system.parameter_names, slopes, strict=True)) if i != place}
    extremum = "minimum" if found.curvature > 0 else "maximum"
    orbit = problem.orbit(y, f"fold of {parameter}: conditions of optimality met to {found.error:.1e}")
    status = f"{extremum} of {parameter} over the cycles near by, {found.why}; no bound is active"
    return Critical(
        kind="fold",
        parameter=parameter,
        value=float(y[-1]),
        extremum=extremum,
        omega=orbit.omega,
        gradient=gradient,
        orbit=orbit,
        residual=found.error,
        curvature=found.curvature,
        status=status,
    )
