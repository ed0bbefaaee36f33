"""A point of a search with its functions and constraints, and the step that a quadratic program takes from it."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Sample(Generic[T]):
    """Functions and constraints at a point, scaled to order one.

    Attributes
    ----------
    f : dict of float
        The functions whose largest is minimised, by name.
    c : dict of float
        The constraints c <= 0, by name.
    slopes : dict of ndarray, shape (n,)
        Gradients of both, by name.
    point : object
        Data that the caller keeps with it.
    curvatures : dict of callable
        Functions without arguments that return second derivatives, shape (n, n), by name, where these are known.
    """

    f: dict[str, float]
    c: dict[str, float]
    slopes: dict[str, Array]
    point: T
    curvatures: dict[str, Callable[[], Array]] = field(default_factory=dict)

    __repr__ = brief

    @property
    def largest(self) -> float:
        """The largest function."""
        return max(self.f.values())

    @property
    def violation(self) -> float:
        """Sum of the violations of the constraints."""
        return sum(max(c, 0.0) for c in self.c.values())


@dataclass(frozen=True, eq=False)
class Step:
    """Solution of the quadratic program: the step, multipliers by name, remaining violation, value of the model."""

    d: Array
    weights: dict[str, float]
    slack: float
    model: float


def step_within(
    here: Sample[Any], B: Array, x: Array, radius: float, penalty: float, values: dict[str, float] | None = None
) -> Step:
    """Minimise t + d B d / 2 + penalty * sum of s subject to f + g d <= t, c + a d <= s, s >= 0 in the trust region."""
    n, names = len(x), [*here.f, *here.c]
    k = len(here.c)
    now = {**here.f, **here.c} if values is None else values
    top = max(now[i] for i in here.f)  # t is measured from its present value, to be as small as the other unknowns
    A = np.zeros((len(names), n + 1 + k))
    A[:, :n] = [here.slopes[i] for i in names]
    A[: len(here.f), n] = -1.0
    A[len(here.f) :, n + 1 :] = -np.eye(k)
    right = np.array([top * (i in here.f) - now[i] for i in names])
    H = np.zeros((n + 1 + k, n + 1 + k))
    H[:n, :n] = B
    lower = np.concatenate([np.maximum(-radius, -x), [-np.inf], np.zeros(k)])
    upper = np.concatenate([np.minimum(radius, 1 - x), np.full(1 + k, np.inf)])
    cost = np.concatenate([np.zeros(n), [1.0], np.full(k, penalty)])
    with contextlib.redirect_stdout(io.StringIO()):  # the solver prints its name whatever its options are
        solver = _solver(n + 1 + k, len(names))
        out = solver(h=H, g=cost, a=A, lba=-np.inf, uba=right, lbx=lower, ubx=upper)
    y, lam = out["x"].full().ravel(), out["lam_a"].full().ravel()
    d = np.clip(y[:n], lower[:n], upper[:n])
    reached = dict(zip(names, A[:, :n] @ d, strict=True))
    slack = sum(max(now[i] + reached[i], 0.0) for i in here.c)
    model = max(now[i] + reached[i] for i in here.f) + 0.5 * d @ B @ d + penalty * slack
    weights = {i: float(w) for i, w in zip(names, lam, strict=True) if w > 1e-10}
    if not any(i in weights for i in here.f):
        raise ConvergenceError(f"the quadratic program of a step was not solved: {solver.stats()['return_status']}.")
    return Step(d, weights, slack, float(model))


_SOLVERS: dict[tuple[int, int], ca.Function] = {}


def _solver(size: int, rows: int) -> ca.Function:
    """Return the solver of quadratic programs of this size, built once."""
    if (size, rows) not in _SOLVERS:
        options = {"error_on_fail": False, "printLevel": "none", "sparse": False}
        shapes = {"h": ca.Sparsity.dense(size, size), "a": ca.Sparsity.dense(rows, size)}
        _SOLVERS[size, rows] = ca.conic("step", "qpoases", shapes, options)
    return _SOLVERS[size, rows]


def corrected(here: Sample[Any], there: Sample[Any], d: Array) -> dict[str, float]:
    """Return values such that the linear model is right at the point tried (second-order correction)."""
    now = {**here.f, **here.c}
    tried = {**there.f, **there.c}
    return {i: tried[i] - float(here.slopes[i] @ d) if i in tried else value for i, value in now.items()}
