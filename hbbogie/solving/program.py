"""The nonlinear program over a cycle and free parameters, for IPOPT: built once, scaled, with exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.solving.expressions import Cycle, CycleFunction

SOLVER: dict[str, Any] = {
    "print_time": False, "calc_lam_p": False,
    "ipopt": {
        "print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-10, "constr_viol_tol": 1e-10,
        "mu_init": 1e-3, "bound_push": 1e-8, "bound_frac": 1e-8,
        "nlp_scaling_method": "none",  # the problem is already scaled
    },
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Program:
    """The parts that are built once: objective and limits with derivatives, and the solver."""

    quantities: ca.Function  # (z, p) -> objective, its derivative in (z, p), limits, their derivatives
    solver: ca.Function
    sizes: tuple[int, ...]


def _expression(function: CycleFunction, cycle: Cycle) -> ca.MX:
    """Return the expression of an objective or limit for a cycle; raise `ModelError` if it is not an expression."""
    value: Any = function(cycle)
    try:
        return ca.MX(value)
    except NotImplementedError:
        raise ModelError(f"minimise: a function returned {value!r}; return an expression of the cycle.") from None


def nonlinear_program(equations: Equations, free: tuple[int, ...], functions: Sequence[CycleFunction]) -> Program:
    """Return the program's functions, built once for the same free parameters and callables."""
    m, n_p, n_y = equations.size, equations.residual.size1_in(1), equations.size + len(free)
    z, p = ca.MX.sym("z", m), ca.MX.sym("p", n_p)
    cycle = Cycle(equations, z, p)
    f, *limits = (_expression(function, cycle) for function in functions)
    if not f.is_scalar():
        raise ModelError(f"minimise: the objective has shape {f.shape}; it must be one number.")
    g = ca.vertcat(*(ca.vec(limit) for limit in limits)) if limits else ca.MX(0, 1)
    zp = ca.vertcat(z, p)
    quantities = ca.Function("quantities", [z, p], [f, ca.jacobian(f, zp), g, ca.jacobian(g, zp)])
    x, sizes = ca.MX.sym("x", n_y), tuple(limit.numel() for limit in limits)
    parts = [("p", n_p), ("scale", n_y), ("rows", m), ("f_scale", 1), ("g_rows", sum(sizes))]
    theta = [ca.MX.sym(name, k) for name, k in parts]
    values, scale, rows, f_scale, g_rows = theta
    y = x * scale
    q = ca.MX(values)
    for k, i in enumerate(free):
        q[i] = y[m + k]
    columns = [*range(m), *(m + i for i in free)]
    value = ca.Function("value", [z, p], [f, g])
    lam = ca.MX.sym("lam", 1 + sum(sizes))
    lagrangian = lam[0] * f + (ca.dot(lam[1:], g) if limits else 0)
    second = ca.hessian(lagrangian, zp)[0][columns, columns]
    bent = ca.Function("bent", [z, p, lam], [second])
    f_y, g_y = value(y[:m], q)
    _, df, _, dg = quantities(y[:m], q)
    F, J = equations.derivatives(free)(y[:m], q)
    J = ca.vertcat(J / ca.repmat(rows, 1, n_y), dg[:, columns] / ca.repmat(g_rows, 1, n_y)) * ca.repmat(
        scale.T, m + sum(sizes), 1
    )
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", m + sum(sizes))
    H = equations.hessian(free)(y[:m], q, lam_g[:m] / rows)
    H = H + bent(y[:m], q, ca.vertcat(lam_f * f_scale, lam_g[m:] / g_rows))
    H = ca.triu(ca.densify(H) * ca.mtimes(scale, scale.T))
    everything = ca.vertcat(*theta)
    # a gradient with structural zeros would be read as a vector of its nonzero entries only
    together, gradient = ca.vertcat(F / rows, g_y / g_rows), ca.densify(f_scale * df[columns] * scale.T)
    hessian = ca.Function("hess_lag", [x, everything, lam_f, lam_g], [H], ["x", "p", "lam_f", "lam_g"], ["hess_lag"])
    options = SOLVER | {
        "grad_f": ca.Function("grad_f", [x, everything], [f_scale * f_y, gradient.T], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, everything], [together, J], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": hessian,
    }
    program = {"x": x, "p": everything, "f": f_scale * f_y, "g": together}
    return Program(quantities, ca.nlpsol("optimum", "ipopt", program, options), sizes)
