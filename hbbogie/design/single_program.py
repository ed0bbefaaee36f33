"""The design task as one nonlinear program with the critical points as constraints: a cross-check of the search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.critical.curvature import HopfConditions, hopf_conditions
from hbbogie.critical.folds import Critical
from hbbogie.design.criteria import Expression, Limit
from hbbogie.design.point import DesignPoint
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System

Array = NDArray[np.float64]
IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    "hessian_approximation": "limited-memory",
    "limited_memory_max_history": 30,
    "nlp_scaling_method": "none",  # the program is already scaled
    "mu_init": 1e-3,
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
}


@dataclass(frozen=True, eq=False)
class SingleLevel:
    """Solution of the single nonlinear program.

    Attributes
    ----------
    parameters : dict of float
    value : float
        The smallest of the critical values in the program.
    multipliers : dict of float
        Gain of the value per unit by which a limit is relaxed, by the name of its quantity.
    converged : bool
    status : str
        Status of the solver, with the number of iterations.
    """

    parameters: dict[str, float]
    value: float
    multipliers: dict[str, float]
    converged: bool
    status: str

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class _Block:
    """Equations of one critical point: scaled start, equations, their Jacobian in (x, u), and the scaled value."""

    start: Array
    equations: ca.MX
    jacobian: ca.MX
    value: ca.MX


def single_level(
    point: DesignPoint,
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[Limit] = (),
    *,
    iterations: int = 500,
) -> SingleLevel:
    """Maximise the smallest critical value in one nonlinear program, by IPOPT.

    The unknowns are the parameters, the value t to be raised, and the unknowns of every critical point that exists at
    the start: cycle, value and multipliers of a fold; equilibrium, eigenvector, frequency and value of a Hopf point.
    The constraints are t <= each value and the equations of each point: F = 0 with the conditions of optimality
    (eq-fold-optimality) for a fold, and the equations of the critical eigenvector for a Hopf point.

    Parameters
    ----------
    point : DesignPoint
        Where the search begins; its critical points are those of the program.
    over : mapping of (float, float)
        Bounds of the parameters, by name.
    subject_to : sequence of Limit
        Limits on functions of the parameters (`Expression`) only.
    iterations : int
        Largest number of iterations.

    Returns
    -------
    SingleLevel

    Raises
    ------
    ModelError
        For other limits, or a design without critical points.

    Notes
    -----
    First derivatives are exact; that of the fold's conditions is the Hessian of its Lagrangian. Second derivatives
    would require third derivatives of F and are approximated (limited memory). Critical points that do not exist at the
    start are not seen. This is why the program serves only as a cross-check.
    """
    system, names = point.system, list(over)
    if any(not isinstance(limit.quantity, Expression) for limit in subject_to):
        raise ModelError(
            "single_level: only limits on functions of the parameters (Expression) are allowed in the program."
        )
    if not point.critical:
        raise ModelError("single_level: the design has no critical point in the range, so there is nothing to raise.")
    place = system.parameter_names.index(point.parameter)
    places = [system.parameter_names.index(n) for n in names]
    low, width = (np.array([f(*over[n]) for n in names]) for f in (lambda a, b: a, lambda a, b: b - a))
    u, t = ca.MX.sym("u", len(names)), ca.MX.sym("t")
    p = ca.MX(system.vector())
    for k, i in enumerate(places):
        p[i] = low[k] + width[k] * u[k]
    scale = max(abs(c.value) for c in point.critical) or 1.0
    xs, blocks = [], []
    for k, c in enumerate(point.critical):
        build = _fold_block if c.kind == "fold" else _hopf_block
        x, block = build(point.equations, c, place, places, p, width, scale, f"x{k}")
        xs.append(x)
        blocks.append(block)
    rows, lower, upper = _limit_rows(system, subject_to, p)
    start_u = np.clip((system.vector()[places] - low) / width, 0, 1)
    w = ca.vertcat(u, t, *xs)
    g = ca.vertcat(rows, *(b.value - t for b in blocks), *(b.equations for b in blocks))
    sizes = [b.equations.numel() for b in blocks]
    jacobian = _assembled(u, w, xs, blocks, rows)
    options: dict[str, Any] = {
        "print_time": False,
        "jac_g": ca.Function("jac_g", [w, ca.MX.sym("none", 0)], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "ipopt": {**IPOPT, "max_iter": iterations},
    }
    solver = ca.nlpsol("design", "ipopt", {"x": w, "f": -t, "g": g}, options)
    x0 = np.concatenate([start_u, [point.value / scale], *(b.start for b in blocks)])
    free = np.full(len(x0) - len(names), np.inf)
    answer = solver(
        x0=x0,
        lbx=np.concatenate([np.zeros(len(names)), -free]),
        ubx=np.concatenate([np.ones(len(names)), free]),
        lbg=np.concatenate([lower, np.zeros(len(blocks)), np.zeros(sum(sizes))]),
        ubg=np.concatenate([upper, np.full(len(blocks), np.inf), np.zeros(sum(sizes))]),
    )
    x, lam = answer["x"].full().ravel(), answer["lam_g"].full().ravel()
    statistics = solver.stats()
    slopes = [lam[k] * scale / _size(limit) for k, limit in enumerate(subject_to)]
    return SingleLevel(
        dict(zip(names, map(float, low + width * x[: len(names)]), strict=True)),
        float(x[len(names)] * scale),
        {limit.quantity.name: abs(float(s)) for limit, s in zip(subject_to, slopes, strict=True)},
        bool(statistics["success"]),
        f"{statistics['return_status']} after {statistics['iter_count']} iterations",
    )


def _size(limit: Limit) -> float:
    return max((abs(b) for b in (limit.lower, limit.upper) if np.isfinite(b)), default=1.0) or 1.0


def _limit_rows(system: System, limits: Sequence[Limit], p: ca.MX) -> tuple[ca.MX, Array, Array]:
    values = [limit.quantity.functions(system)[0](p)[0] / _size(limit) for limit in limits]  # type: ignore[attr-defined]
    bounds = np.array([[limit.lower / _size(limit), limit.upper / _size(limit)] for limit in limits]).reshape(-1, 2)
    return ca.vertcat(*values) if values else ca.MX(0, 1), bounds[:, 0], bounds[:, 1]


def _assembled(u: ca.MX, w: ca.MX, xs: list[ca.MX], blocks: list[_Block], rows: ca.MX) -> ca.MX:
    """Return the Jacobian of all constraints, with those of the blocks at their places."""
    n, offset = u.numel(), u.numel() + 1
    simple = ca.vertcat(rows, *(b.value - w[n] for b in blocks))
    parts = [ca.jacobian(simple, w)]
    for x, b in zip(xs, blocks, strict=True):
        m, k = b.equations.numel(), x.numel()
        before, after = offset - n, w.numel() - offset - k
        parts.append(ca.horzcat(b.jacobian[:, k:], ca.MX(m, before), b.jacobian[:, :k], ca.MX(m, after)))
        offset += k
    return ca.vertcat(*parts)


def _fold_block(
    equations: Equations, c: Critical, place: int, places: list[int], p: ca.MX, width: Array, scale: float, name: str
) -> tuple[ca.MX, _Block]:
    """Return unknowns (y, multipliers) and equations (F, gradient of the Lagrangian) of a fold, scaled."""
    equations = equations.phased(c.orbit)
    m, free = equations.size, (place, *places)
    sizes, rows = np.append(equations.scale, scale), equations.residual_scale
    x = ca.MX.sym(name, 2 * m + 1)
    y, lam = x[: m + 1] * sizes, x[m + 1 :]
    at = ca.MX(p)
    at[place] = y[m]
    columns = ca.DM(np.concatenate([sizes, width]))
    F, J = equations.derivatives(free)(y[:m], at)
    J = J * ca.repmat(columns.T, m, 1) / ca.repmat(ca.DM(rows), 1, len(columns.full()))
    H = equations.hessian(free)(y[:m], at, lam / rows) * ca.mtimes(columns, columns.T)
    objective = ca.DM(np.append(np.zeros(m), 1.0))
    Jy = J[:, : m + 1]
    L = objective + ca.mtimes(Jy.T, lam)
    top = ca.horzcat(Jy, ca.MX(m, m), J[:, m + 1 :])
    bottom = ca.horzcat(H[: m + 1, : m + 1], Jy.T, H[: m + 1, m + 1 :])
    z = equations.encode(c.orbit)
    numbers = equations.system.vector(**c.orbit.parameters)
    numbers[place] = c.value
    slopes = equations.derivatives((place,))(z, numbers)[1].full() / rows[:, None] * sizes
    multipliers = np.linalg.lstsq(slopes.T, -objective.full().ravel(), rcond=None)[0]
    start = np.concatenate([np.append(z, c.value) / sizes, multipliers])
    return x, _Block(start, ca.vertcat(F / rows, L), ca.vertcat(top, bottom), x[m])


def _hopf_block(
    equations: Equations, c: Critical, place: int, places: list[int], p: ca.MX, width: Array, scale: float, name: str
) -> tuple[ca.MX, _Block]:
    """Return unknowns (equilibrium, eigenvector, omega, value) and equations of a Hopf point, scaled."""
    system = equations.system
    numbers = system.vector(**c.orbit.parameters)
    numbers[place] = c.value
    plain, first = system.once(("hopf conditions", place), lambda: hopf_conditions(system, place))
    at = HopfConditions(system, c, numbers)
    sizes = np.concatenate([np.full(system.n, equations.scale[0]), np.ones(2 * system.n_states), [c.omega, scale]])
    rows = np.abs(at.by_unknowns * sizes).max(axis=1)
    x = ca.MX.sym(name, len(sizes))
    given = (x * sizes, p, *at.w)
    G, (Gy, Gp) = plain(*given) / rows, first(*given)
    Gu = Gp[:, places] * ca.repmat(ca.DM(width).T, len(rows), 1)
    jacobian = ca.horzcat(Gy * ca.repmat(ca.DM(sizes).T, len(rows), 1), Gu) / ca.repmat(
        ca.DM(rows), 1, len(sizes) + len(width)
    )
    return x, _Block(at.y / sizes, G, jacobian, x[len(sizes) - 1])
