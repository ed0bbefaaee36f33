"""Solving the equations of a cycle: Newton's method from warm starts, IPOPT as the safety net."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, overload

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving import optimum
from hbbogie.solving.newton import Conditions, Problem, first_harmonic, newton
from hbbogie.solving.optimum import Constraint, CycleFunction, Optimum

Array = NDArray[np.float64]


def _ipopt(problem: Problem) -> ca.Function:
    """Return the NLP solver for the problem's conditions, built once: scaled unknowns, exact derivatives."""
    equations, conditions = problem.equations, problem.conditions

    def build() -> ca.Function:
        m, n_p, n_y = equations.size, len(problem.p), len(problem.scale)
        x = ca.MX.sym("x", n_y)
        # parameters of the NLP: p, the scales of unknowns and rows, the prescribed amplitude
        parts = [ca.MX.sym(n, k) for n, k in (("p", n_p), ("scale", n_y), ("rows", len(problem.rows)), ("target", 1))]
        p, scale, rows, target = parts
        theta = ca.vertcat(*parts)
        y, p_free = x * scale, ca.MX(p)
        for k, i in enumerate(conditions.free):
            p_free[i] = y[m + k]
        F, J = equations.derivatives(conditions.free)(y[:m], p_free)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", len(problem.rows))
        weights = lam_g / rows
        H = equations.hessian(conditions.free)(y[:m], p_free, weights[:m])
        if conditions.amplitude is not None:
            g, dg = first_harmonic(equations, conditions)(y[:m], p_free)
            F, J = ca.vertcat(F, g - target), ca.vertcat(J, dg)
        J = J * ca.repmat(scale.T, J.shape[0], 1) / ca.repmat(rows, 1, n_y)
        H = ca.triu(H * ca.mtimes(scale, scale.T))
        options: dict[str, Any] = {
            "print_time": False,
            "jac_g": ca.Function("jac_g", [x, theta], [F / rows, J], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function("hess_lag", [x, theta, lam_f, lam_g], [H], ["x", "p", "lam_f", "lam_g"], ["h"]),
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": 300,
                "tol": 1e-10,
                "constr_viol_tol": 1e-10,
                "mu_init": 1e-4,  # starts are guesses worth keeping: little push towards the middle
                "bound_push": 1e-8,
                "bound_frac": 1e-8,
                "nlp_scaling_method": "none",  # the problem is scaled already
            },
        }
        return ca.nlpsol("cycle", "ipopt", {"x": x, "p": theta, "f": ca.MX(0), "g": F / rows}, options)

    return equations.once(("ipopt", conditions), build)


def _by_ipopt(problem: Problem, y: Array) -> tuple[Array, dict[str, Any]]:
    solver = _ipopt(problem)
    theta = np.concatenate([problem.p, problem.scale, problem.row_scale, [problem.target]])
    result = solver(
        x0=y / problem.scale,
        p=theta,
        lbg=0,
        ubg=0,
        lbx=problem.lower / problem.scale,
        ubx=problem.upper / problem.scale,
    )
    statistics = solver.stats()
    return result["x"].full().ravel() * problem.scale, {
        "return_status": statistics["return_status"],
        "iterations": statistics["iter_count"],
    }


@overload
def solve(
    equations: Equations,
    guess: Orbit,
    *,
    free: str | None = ...,
    amplitude: Mapping[str, float] | None = ...,
    minimise: None = ...,
    subject_to: Sequence[Constraint] = ...,
    method: str = ...,
    tolerance: float = ...,
    **fixed: float,
) -> Orbit: ...


@overload
def solve(
    equations: Equations,
    guess: Orbit,
    *,
    free: str | Sequence[str] | None = ...,
    amplitude: Mapping[str, float] | None = ...,
    minimise: CycleFunction,
    subject_to: Sequence[Constraint] = ...,
    method: str = ...,
    tolerance: float = ...,
    **fixed: float,
) -> Optimum: ...


def solve(
    equations: Equations,
    guess: Orbit,
    *,
    free: str | Sequence[str] | None = None,
    amplitude: Mapping[str, float] | None = None,
    minimise: CycleFunction | None = None,
    subject_to: Sequence[Constraint] = (),
    method: str = "auto",
    tolerance: float = 1e-10,
    **fixed: float,
) -> Orbit | Optimum:
    """Solve for a cycle: at given parameters, at a given amplitude with one parameter unknown, or the best one.

    Parameters
    ----------
    equations : Equations
        From `HarmonicBalance(...).equations(system)` or another method.
    guess : Orbit
        Where the search begins; its parameter values are not used, but for that of ``free``.
    free : str, or sequence of str, optional
        Name of the parameter to be found, which asks for ``amplitude``; or names of those over which to minimise.
    amplitude : mapping of one coordinate name to float, optional
        First-harmonic amplitude of that coordinate, in its unit.
    minimise : callable, optional
        `optimum.Cycle` -> scalar expression, such as ``lambda cycle: cycle.parameter("V")`` for a fold: the cycle near
        the guess at which it is smallest is found, see `optimum.minimise`.
    subject_to : sequence of (callable, lower, upper)
        Limits of further expressions of the cycle; None for no limit.
    method : {"auto", "newton", "ipopt"}
        Without ``minimise``: "auto" tries Newton's method first and goes to IPOPT, which keeps to the bounds, when
        that fails.
    tolerance : float
        Largest scaled residual accepted.
    **fixed : float
        Parameter values; those not named are the values of the equations' system.

    Returns
    -------
    Orbit, or with ``minimise`` an `optimum.Optimum`

    Raises
    ------
    ConvergenceError
        With the last iterate, the worst equation, the active bounds and what to try.
    ModelError
        For an unknown parameter or coordinate, or conditions that do not fit together.

    Examples
    --------
    ``solve(balance, guess, V=100.0)``; ``solve(balance, guess, amplitude={"q1": 0.0104}, free="V")``;
    ``solve(balance, guess, free=["V"], minimise=lambda cycle: cycle.parameter("V"))``
    """
    equations = equations.phased(guess)
    if minimise is not None:
        if amplitude is not None or free is None or method != "auto":
            raise ModelError("solve: minimise= goes with free= and subject_to= only; leave amplitude= and method= out.")
        names = [free] if isinstance(free, str) else list(free)
        return optimum.minimise(equations, guess, names, minimise, subject_to, **fixed)
    if subject_to:
        raise ModelError("solve: subject_to= asks for minimise=; say what is to be smallest.")
    if free is not None and not isinstance(free, str):
        raise ModelError(f"solve: free={list(free)!r} asks for minimise=; with amplitude= give one name.")
    if method not in ("auto", "newton", "ipopt"):
        raise ModelError(f"solve: {unknown_name('method', method, ('auto', 'newton', 'ipopt'))}")
    conditions, target = _conditions(equations, free, amplitude, fixed)
    p = equations.system.vector(**fixed)
    for i in conditions.free:
        p[i] = guess.parameters.get(equations.system.parameter_names[i], p[i])
    problem = Problem(equations, conditions, p, target)
    start = np.concatenate([equations.encode(guess), p[problem.free]])
    statistics: dict[str, Any] = {}
    y = start
    if method != "ipopt":
        y, error, iterations = newton(problem, start, tolerance)
        if error <= tolerance and not problem.violated(y):
            return problem.orbit(y, f"converged by Newton's method in {iterations} iterations")
        statistics = {
            "return_status": "Newton's method did not converge within the bounds",
            "iterations": iterations,
        }
    if method != "newton":
        y, statistics = _by_ipopt(problem, np.clip(start, problem.lower, problem.upper))
        polished, error, _ = newton(problem, y, tolerance)
        if error <= tolerance and not problem.violated(polished, 1e-9):
            return problem.orbit(polished, f"converged by IPOPT in {statistics['iterations']} iterations")
    raise _failure(problem, y, statistics)


def _conditions(
    equations: Equations, free: str | None, amplitude: Mapping[str, float] | None, fixed: Mapping[str, float]
) -> tuple[Conditions, float]:
    system = equations.system
    if (free is None) != (amplitude is None):
        raise ModelError(
            f"solve: got free={free!r} and amplitude={amplitude!r}; give both (the amplitude to reach and the "
            "parameter to find) or neither."
        )
    if free is None or amplitude is None:
        return Conditions(), 0.0
    if len(amplitude) != 1:
        raise ModelError(f"solve: amplitude={dict(amplitude)!r}; give one coordinate, such as {{'q1': 0.01}}.")
    if free in fixed:
        raise ModelError(f"solve: parameter {free!r} is asked to be both free and fixed; leave one out.")
    (name, value), _ = next(iter(amplitude.items())), system.parameter(free)
    if not np.isfinite(value) or value <= 0:
        raise ModelError(f"solve: amplitude of {name!r} is {value!r}; give a positive number.")
    if equations.phase is None:
        raise ModelError("solve: an equilibrium (harmonics 0) has no amplitude; ask for at least one harmonic.")
    return Conditions((system.parameter_names.index(free),), system.index(name)), float(value)


def _failure(problem: Problem, y: Array, statistics: dict[str, Any]) -> ConvergenceError:
    F, _ = problem.evaluate(y)
    scaled = np.abs(F / problem.row_scale)
    worst, bounds = (
        int(np.nanargmax(np.where(np.isfinite(scaled), scaled, np.inf))),
        problem.violated(y, 1e-6),
    )
    small = any("lower bound" in b and "cosine of harmonic 1" in b for b in bounds)
    advice = (
        "the cycle shrank to the equilibrium: there may be no cycle at these parameters; look where cycles exist with "
        "find_cycles or trace"
        if small
        else "there may be no cycle here, or the guess is too far: go there in smaller steps with trace, start from "
        "find_cycles, or take fewer harmonics first"
    )
    at = {
        problem.equations.system.parameter_names[i]: y[problem.equations.size + k] for k, i in enumerate(problem.free)
    }
    text = (
        f"no cycle found ({problem.equations.method}; {statistics.get('return_status', 'stopped')} after "
        f"{statistics.get('iterations', 0)} iterations). Worst: {problem.rows[worst]}, scaled residual "
        f"{scaled[worst]:.2e}. Active bounds: {', '.join(bounds) or 'none'}."
        + (f" Last value of {', '.join(f'{k} = {v:g}' for k, v in at.items())}." if at else "")
        + f" What to try: {advice}."
    )
    statistics |= {"worst": problem.rows[worst], "residual": float(scaled[worst]), "active_bounds": bounds}
    return ConvergenceError(text, problem.orbit(y, "did not converge"), statistics)
