"""Minimise the largest of several smooth functions under constraints; their number may change during the search.

The method is sequential quadratic programming with an exact penalty in a trust region. The functions are separate rows
of the program, so the kink where another function becomes the largest needs no smoothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.design.quadratic_step import Sample, Step, corrected, step_within
from hbbogie.results.failure import FAILURES

Array = NDArray[np.float64]
T = TypeVar("T")
ACCEPTED, GOOD = 0.05, 0.7  # share of the predicted improvement at which a step is accepted, and the next may be longer
ROUND_OFF = 1e-13  # relative improvement too small to be measured
STATIONARY = 1e-6  # smallest reduction of the violations that counts, as a share
LONGEST, SHORTEST = 0.5, 1e-9  # largest and smallest radius of the trust region
PENALTY, HIGHEST = 1.0, 1e6  # weight of violated constraints: initial and largest
LEAST, AMPLE = 0.1, 10.0  # that weight is at least the first number, and the second times the largest multiplier


@dataclass(frozen=True, eq=False)
class Minimum(Generic[T]):
    """How the search ended.

    Attributes
    ----------
    x : ndarray, shape (n,)
    sample : Sample
        There.
    weights : dict of float
        Nonzero weights of the functions, which add up to 1, and nonzero multipliers of the constraints, by name.
    bounds : ndarray, shape (n,)
        Multipliers of the bounds: positive at an upper one, negative at a lower one.
    residual : float
        Largest entry of the gradient of the Lagrangian.
    converged : bool
    status : str
    history : list of tuple
        Largest function, violation and radius at each iteration.
    interrupted : bool
        Whether the search was ended by `KeyboardInterrupt`, with the best point so far.
    """

    x: Array
    sample: Sample[T]
    weights: dict[str, float]
    bounds: Array
    residual: float
    converged: bool
    status: str
    history: list[tuple[float, float, float]] = field(default_factory=list)
    interrupted: bool = False

    __repr__ = brief


def minimise_largest(
    evaluate: Callable[[Array, T | None], Sample[T]],
    x: Array,
    near: T | None = None,
    *,
    tolerance: float = 1e-7,
    iterations: int = 80,
) -> Minimum[T]:
    """Minimise the largest of several functions over the unit cube, subject to constraints.

    Parameters
    ----------
    evaluate : callable
        (x, data kept at a nearby point) -> Sample. It raises `ConvergenceError` or another numerical error if it fails,
        which shortens the step, and `KeyboardInterrupt` to end the search with the best point so far.
    x : ndarray, shape (n,)
        Where the search begins.
    near : object, optional
        Data kept at a point near the start.
    tolerance : float
        Largest entry of the gradient of the Lagrangian, and largest violation.
    iterations : int

    Returns
    -------
    Minimum

    Raises
    ------
    ConvergenceError
        When the functions cannot be evaluated at the start, or the program of a step is not solved.

    References
    ----------
    R. Fletcher, Practical Methods of Optimization, second edition, Wiley 1987, section 14.4 (exact penalty, trust
    region); M. J. D. Powell, in Numerical Analysis (Dundee 1977), Springer 1978, 144-157 (damped update).
    """
    here = evaluate(x, near)
    radius, penalty = 0.2, PENALTY
    B = rest = np.zeros((len(x), len(x)))
    history: list[tuple[float, float, float]] = []
    status, interrupted = f"not converged after {iterations} iterations", False
    for _ in range(iterations):
        history.append((here.largest, here.violation, radius))
        step, penalty, least = _weighted(here, B, x, radius, penalty)
        stuck = here.violation - least <= STATIONARY * here.violation
        if step.slack > 1e-12 and here.violation > tolerance and stuck:
            status = f"ended after {len(history)} iterations: the constraints nearby contradict each other"
            break
        residual = float(np.abs(_projected(here, step, x)).max())
        if residual <= tolerance and here.violation <= tolerance:
            return _minimum(here, step, x, residual, True, f"converged in {len(history)} iterations", history)
        expected = here.largest + penalty * here.violation - step.model
        try:
            step, there, gain = _best_tried(evaluate, here, B, x, radius, penalty, step, expected)
        except KeyboardInterrupt:
            status, interrupted = f"was interrupted in iteration {len(history)}; this is the best design so far", True
            break
        length = float(np.abs(step.d).max())
        if there is not None and abs(expected) <= ROUND_OFF * max(1.0, abs(here.largest)):
            gain = expected  # too small to be measured, so accept the step, which improves the optimality conditions
        if there is None or gain < ACCEPTED * expected:
            radius = min(radius, length) / 3
            if radius < SHORTEST:
                status = "no better design was found within the shortest step"
                break
            continue
        if gain > GOOD * expected and length > 0.9 * radius:
            radius = min(2 * radius, LONGEST)
        elif gain < 0.3 * expected:
            radius = max(length / 2, SHORTEST)
        rest = _updated(rest, here, there, step)
        x, here = np.clip(x + step.d, 0.0, 1.0), there
        largest = max((w for i, w in step.weights.items() if i in here.c), default=0.0)
        penalty = min(penalty, max(AMPLE * largest, LEAST))  # if too large, no step could follow a curved constraint
        B = _known(here, {i: w for i, w in step.weights.items() if i in here.slopes}, x) + rest
    if here.violation > tolerance:
        worst = max(here.c, key=lambda name: here.c[name])
        status += f"; {worst}, is violated by {here.c[worst]:.2g} of its size"
    step = step_within(here, B, x, SHORTEST, penalty)
    residual = float(np.abs(_projected(here, step, x)).max())
    return _minimum(here, step, x, residual, False, status, history, interrupted)


def _weighted(here: Sample[Any], B: Array, x: Array, radius: float, penalty: float) -> tuple[Step, float, float]:
    """Return a step, the penalty, and the least violation within the region.

    The penalty is large enough if a step removes half of the violation that can be removed within the region.
    """
    step = step_within(here, B, x, radius, penalty)
    if step.slack <= 1e-12:
        return step, penalty, 0.0
    least = step_within(here, B, x, radius, HIGHEST).slack
    while penalty < HIGHEST and here.violation - step.slack < 0.5 * (here.violation - least):
        penalty *= 10
        step = step_within(here, B, x, radius, penalty)
    return step, penalty, least


def _best_tried(
    evaluate: Callable[[Array, T | None], Sample[T]],
    here: Sample[T],
    B: Array,
    x: Array,
    radius: float,
    penalty: float,
    step: Step,
    expected: float,
) -> tuple[Step, Sample[T] | None, float]:
    """Return a step, or a corrected one where this is not good enough, with what is there and how much it gains."""

    def gained(there: Sample[T] | None) -> float:
        if there is None:
            return -np.inf
        return here.largest - there.largest + penalty * (here.violation - there.violation)

    there = _tried(evaluate, x + step.d, here.point)
    gain = gained(there)
    if there is None or gain >= ACCEPTED * expected:
        return step, there, gain
    second = step_within(here, B, x, radius, penalty, corrected(here, there, step.d))
    again = _tried(evaluate, x + second.d, here.point)
    return (second, again, gained(again)) if gained(again) > gain else (step, there, gain)


def _tried(evaluate: Callable[[Array, T | None], Sample[T]], x: Array, near: T) -> Sample[T] | None:
    try:
        return evaluate(np.clip(x, 0.0, 1.0), near)
    except FAILURES:
        return None


def _lagrangian(sample: Sample[Any], weights: dict[str, float]) -> Array | None:
    """Return the gradient of the Lagrangian; None if one of its rows does not exist at the sample."""
    if not all(i in sample.slopes for i in weights):
        return None
    return np.asarray(sum(w * sample.slopes[i] for i, w in weights.items()))


def _projected(sample: Sample[Any], step: Step, x: Array) -> Array:
    """Return the gradient of the Lagrangian without what active bounds hold, followed by the complementarity gaps."""
    g = _lagrangian(sample, step.weights)
    g = np.zeros(len(x)) if g is None else g
    held = _held(x, g)
    open_ = [w * abs(top - value) for i, w in step.weights.items() for value, top in [_gap(sample, i)]]
    return np.append(np.where(held, 0.0, g), open_)


def _gap(sample: Sample[Any], name: str) -> tuple[float, float]:
    return (sample.f[name], sample.largest) if name in sample.f else (min(sample.c[name], 0.0), 0.0)


def _known(sample: Sample[Any], weights: dict[str, float], x: Array) -> Array:
    """Return the known part of the Hessian of the Lagrangian along the active rows and bounds.

    Across these no step is free, and there the Hessian may be indefinite, which the quadratic program does not allow.
    """
    H = sum((w * sample.curvatures[i]() for i, w in weights.items() if i in sample.curvatures), np.zeros((len(x),) * 2))
    slopes = [sample.slopes[i] for i in weights if i in sample.f]
    g = _lagrangian(sample, weights)
    held = np.eye(len(x))[_held(x, np.zeros(len(x)) if g is None else g)]
    A = np.vstack([*(s - slopes[0] for s in slopes[1:]), *(sample.slopes[i] for i in weights if i in sample.c), *held,
                   np.zeros(len(x))])  # fmt: skip
    _, sizes, axes = np.linalg.svd(A)
    Z = axes[int((sizes > 1e-6 * max(sizes.max(initial=0.0), 1e-300)).sum()) :].T
    curvatures, directions = np.linalg.eigh(Z.T @ H @ Z)
    Z = Z @ directions
    return np.asarray(Z * np.maximum(curvatures, 0.0) @ Z.T)


def _held(x: Array, g: Array) -> NDArray[np.bool_]:
    """Return which bounds prevent a descent from a point at which a function has the gradient g."""
    return ((x <= 1e-9) & (g > 0)) | ((x >= 1 - 1e-9) & (g < 0))


def _updated(B: Array, here: Sample[Any], there: Sample[Any], step: Step) -> Array:
    """Return Powell's damped update of the Hessian of the rest of the Lagrangian, whose derivatives are not known."""
    weights = {i: w for i, w in step.weights.items() if i not in here.curvatures}
    before, after = _lagrangian(here, weights), _lagrangian(there, weights)
    s = step.d
    if not weights:
        return np.zeros_like(B)
    if before is None or after is None or s @ s < 1e-24:
        return B
    y = after - before
    if not B.any():
        size = abs(float(y @ y) / float(y @ s)) if abs(y @ s) > 1e-16 else 1.0
        B = min(max(size, 1e-3), 1e2) * np.eye(len(s))
    Bs = B @ s
    sBs = float(s @ Bs)
    theta = 1.0 if s @ y >= 0.2 * sBs else 0.8 * sBs / (sBs - float(s @ y))
    r = theta * y + (1 - theta) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / sBs + np.outer(r, r) / float(s @ r))


def _minimum(
    here: Sample[T],
    step: Step,
    x: Array,
    residual: float,
    converged: bool,
    status: str,
    history: list[tuple[float, float, float]],
    interrupted: bool = False,
) -> Minimum[T]:
    g = _lagrangian(here, step.weights)
    g = np.zeros(len(x)) if g is None else g
    at_bound = ((x <= 1e-9) | (x >= 1 - 1e-9)) & (np.abs(g) > 1e-8)
    bounds = np.where(at_bound, -g, 0.0)
    return Minimum(x, here, step.weights, bounds, residual, converged, status, history, interrupted)
