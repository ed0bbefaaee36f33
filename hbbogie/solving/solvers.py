"""Solving the equations of a cycle: Newton's method from a nearby guess, with IPOPT as the fallback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import methodcaller
from typing import Any, overload

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door, positive, unknown_name
from hbbogie.methods.equations import Equations, SolvesItself
from hbbogie.methods.level import within_level
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving import optimum
from hbbogie.solving.expressions import CycleFunction, CycleLimit
from hbbogie.solving.family import asked, in_family, level_of, member, of_family
from hbbogie.solving.newton import Conditions, Problem, newton
from hbbogie.solving.optimum import Optimum
from hbbogie.solving.program import nonlinear_program

Array = NDArray[np.float64]


def _by_ipopt(problem: Problem, y: Array) -> tuple[Array, dict[str, Any]]:
    """Return the result of IPOPT for the equations and conditions as constraints, with nothing to minimise."""
    equations, conditions = problem.equations, problem.conditions
    limited: list[CycleFunction] = []
    if conditions.amplitude is not None:
        limited.append(methodcaller("first_harmonic", equations.system.coordinate_names[conditions.amplitude]))
    solver = equations.once(
        ("cycle by IPOPT", conditions),
        lambda: nonlinear_program(equations, conditions.free, [lambda cycle: ca.MX(0), *limited]).solver,
    )
    scales = [problem.scale, equations.residual_scale, [1.0], [problem.target] * len(limited)]
    goal = np.append(np.zeros(equations.size), np.ones(len(limited)))
    result = solver(
        x0=y / problem.scale,
        p=np.concatenate([problem.p, *scales]),
        lbg=goal,
        ubg=goal,
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
    equations: Equations | SolvesItself,
    guess: Orbit,
    *,
    free: str | None = ...,
    amplitude: Mapping[str, float] | None = ...,
    minimise: None = ...,
    subject_to: Sequence[CycleLimit] = ...,
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
    subject_to: Sequence[CycleLimit] = ...,
    method: str = ...,
    tolerance: float = ...,
    **fixed: float,
) -> Optimum: ...


@door(equations=(Equations, SolvesItself), guess=Orbit, amplitude=Mapping, free=(str, Sequence))
def solve(
    equations: Equations | SolvesItself,
    guess: Orbit,
    *,
    free: str | Sequence[str] | None = None,
    amplitude: Mapping[str, float] | None = None,
    minimise: CycleFunction | None = None,
    subject_to: Sequence[CycleLimit] = (),
    method: str = "auto",
    tolerance: float = 1e-10,
    **fixed: float,
) -> Orbit | Optimum:
    """Solve for a cycle: at given parameters, at a given amplitude with one unknown parameter, or the optimal one.

    Parameters
    ----------
    equations : Equations
        From `HarmonicBalance(...).equations(system)` or another method. Those of `hbbogie.exact.Exact` and
        `hbbogie.Collocation` are solved at given parameter values only.
    guess : Orbit
        Where the search begins. Its parameter values are not used, except that of ``free``. If the equations conserve
        quantities, the cycle has the values of the guess.
    free : str, or sequence of str, optional
        Name of the parameter to be found, which requires ``amplitude``, or names of the parameters over which to
        minimise.
    amplitude : mapping of one coordinate name to float, optional
        First-harmonic amplitude of that coordinate, in its unit. Without ``free`` the cycle is one of a family, as of a
        conservative system, which has cycles of every amplitude at the same parameter values.
    minimise : callable, optional
        `Cycle` -> scalar expression, such as ``lambda cycle: cycle.parameter("V")`` for a fold. The result is the cycle
        near the guess at which it is smallest; see `hbbogie.solving.minimise`.
    subject_to : sequence of (callable, lower, upper)
        Limits of further expressions of the cycle; None means no limit.
    method : {"auto", "newton", "ipopt"}
        Used without ``minimise``. "auto" tries Newton's method first. If it fails, IPOPT follows, which respects the
        bounds.
    tolerance : float
        Largest scaled residual accepted.
    **fixed : float
        Parameter values. All others are those of the equations' system.

    Returns
    -------
    Orbit, or with ``minimise`` an `hbbogie.solving.Optimum`

    Raises
    ------
    ConvergenceError
        When no cycle is found. The error contains the last iterate, the worst equation, the active bounds and what to
        try.
    ModelError
        For an unknown parameter or coordinate, or conditions that do not fit together.

    Examples
    --------
    The cycles of this system have the radius r with mu + r^2 - r^4 = 0, and a fold at mu = -1/4.

    >>> from hbbogie import HarmonicBalance, find_cycles, load_problem
    >>> system = load_problem("bautin").bautin(a=1.0)
    >>> balance = HarmonicBalance(3).equations(system)
    >>> guess = find_cycles(system, mu=-0.1)[-1]
    >>> round(solve(balance, guess, mu=-0.16).amplitude("x") ** 2, 6)
    0.8
    >>> round(solve(balance, guess, amplitude={"x": 0.9}, free="mu").parameters["mu"], 6)
    -0.1539
    >>> round(solve(balance, guess, free=["mu"], minimise=lambda cycle: cycle.parameter("mu")).value, 6)
    -0.25
    """
    if not isinstance(equations, Equations):
        if free is not None or amplitude is not None or minimise is not None or subject_to or method != "auto":
            raise ModelError(
                "solve: these equations are solved at given parameter values only; leave free=, amplitude=, "
                "minimise=, subject_to= and method= out, or take HarmonicBalance(...).equations(system)."
            )
        return equations.solve(guess, **fixed)
    equations = within_level(equations.phased(guess), guess)
    tolerance = positive("solve: tolerance", tolerance, "1")
    if amplitude is not None and free is None and minimise is None:
        return in_family(equations, guess, amplitude, tolerance, **fixed)
    if minimise is not None:
        if amplitude is not None or free is None or method != "auto":
            raise ModelError("solve: minimise= combines only with free= and subject_to=; omit amplitude= and method=.")
        names = [free] if isinstance(free, str) else list(free)
        return optimum.minimise(equations, guess, names, minimise, subject_to, **fixed)
    if subject_to:
        raise ModelError("solve: subject_to= requires minimise=; give the objective.")
    if free is not None and not isinstance(free, str):
        raise ModelError(f"solve: free={list(free)!r} requires minimise=; with amplitude= give one name.")
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
    if free is None and of_family(equations, guess, tolerance):  # that of the same amplitude
        return member(equations, guess, level_of(equations, guess), tolerance, **fixed)
    raise _failure(problem, y, statistics)


def _conditions(
    equations: Equations, free: str | None, amplitude: Mapping[str, float] | None, fixed: Mapping[str, float]
) -> tuple[Conditions, float]:
    system = equations.system
    if free is None:
        return Conditions(), 0.0
    if amplitude is None:
        raise ModelError(f"solve: got free={free!r} without amplitude=; give both, or leave free out.")
    if free in fixed:
        raise ModelError(f"solve: parameter {free!r} is asked to be both free and fixed; leave one out.")
    (name, value), _ = asked(amplitude), system.parameter(free)
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
    small = any(bound.place == problem.equations.leading and bound.side == "lower" for bound in bounds)
    advice = (
        "the cycle shrank to the equilibrium: there may be no cycle at these parameters; look where cycles exist with "
        "find_cycles or trace"
        if small
        else "there may be no cycle here, or the guess is too far away: approach it in smaller steps with trace, start "
        "from find_cycles, or take fewer harmonics first"
    )
    at = {
        problem.equations.system.parameter_names[i]: y[problem.equations.size + k] for k, i in enumerate(problem.free)
    }
    text = (
        f"no cycle found ({problem.equations.method}; {statistics.get('return_status', 'stopped')} after "
        f"{statistics.get('iterations', 0)} iterations). Worst: {problem.rows[worst]}, scaled residual "
        f"{scaled[worst]:.2e}. Active bounds: {', '.join(map(str, bounds)) or 'none'}."
        + (f" Last value of {', '.join(f'{k} = {v:g}' for k, v in at.items())}." if at else "")
        + f" What to try: {advice}."
    )
    statistics |= {"worst": problem.rows[worst], "residual": float(scaled[worst]), "active_bounds": bounds}
    return ConvergenceError(text, problem.orbit(y, "did not converge"), statistics)
