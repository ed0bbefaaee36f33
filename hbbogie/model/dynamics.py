"""The equations of motion as functions: residual, first-order form, linear matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError

if TYPE_CHECKING:
    from hbbogie.model.system import System


def _leading(system: System, residual: ca.Function) -> tuple[list[ca.SX], ca.SX, ca.SX]:
    """Return the symbols (q, v, a, p), the highest derivatives and the residual's Jacobian in them."""
    n = system.n
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, len(system.parameters)), strict=True))
    top = ca.vertcat(*(a[i] if second else v[i] for i, second in enumerate(system.second_order)))
    return [q, v, a, p], top, ca.jacobian(residual(q, v, a, p), top)


def check_leading_matrix(system: System) -> None:
    """Raise `ModelError` unless the equations can be solved for the highest derivatives."""
    (q, v, a, p), top, E = _leading(system, system.residual)
    if ca.depends_on(E, top):
        raise ModelError(
            f"system {system.name!r}: a highest derivative enters nonlinearly; write the equations linear in the "
            "accelerations (or in the velocities of first-order coordinates)."
        )
    at_rest = ca.Function("E", [q, v, a, p], [E])(0, 0, 0, system.vector()).full()
    at_rest_r = system.residual(0, 0, 0, system.vector()).full()
    if not (np.isfinite(at_rest).all() and np.isfinite(at_rest_r).all()):
        raise ModelError(
            f"system {system.name!r}: the equations give {at_rest_r.ravel()} at rest with the default parameters; "
            "they must be finite there (look for a division by zero or a NaN)."
        )
    scale = np.abs(at_rest).max(axis=1, initial=0.0, keepdims=True)
    scaled = at_rest / np.where(scale > 0, scale, 1.0)
    if np.linalg.matrix_rank(scaled) < system.n:
        null = np.abs(np.linalg.svd(scaled)[2][-1])
        guilty = [c for c, w in zip(system.coordinate_names, null, strict=True) if w > 0.1 * null.max()]
        raise ModelError(
            f"system {system.name!r}: the mass matrix is singular at the default parameters (coordinates "
            f"{', '.join(guilty)}); give each coordinate a mass (second order) or a rate (first order)."
        )


def full_residual(system: System) -> ca.Function:
    """Return (q, v, a, p) -> r with the elements' forces put in."""
    n = system.n
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, len(system.parameters)), strict=True))
    f = ca.vertcat(*(e.force(e.argument(q, v, p), p) for e in system.elements))
    return ca.Function("residual", [q, v, a, p], [system.residual_with_forces(q, v, a, f, p)], list("qvap"), ["r"])


def state_matrix(system: System) -> ca.Function:
    """Return (x, p) -> A, the derivative of the first-order form with respect to the state."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    return ca.Function("A", [x, p], [ca.jacobian(system.ode(x, p), x)], ["x", "p"], ["A"])


def first_order_form(system: System) -> ca.Function:
    """Return (x, p) -> dx/dt with x = (q, velocities of the second-order coordinates)."""
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (*[system.n] * 3, len(system.parameters)), strict=True))
    dx = solved_rates(system, system.residual(q, v, a, p), v, a)
    x = state_of(system, q, v)
    return ca.Function("ode", [x, p], [ca.simplify(dx)], ["x", "p"], ["dx"])


def solved_rates(system: System, r: ca.SX, v: ca.SX, a: ca.SX) -> ca.SX:
    """Solve equations r = 0 for the rates of the state (q, v of the second-order coordinates), velocities first."""
    top = ca.vertcat(*(a[i] if s else v[i] for i, s in enumerate(system.second_order)))
    solved = ca.solve(ca.jacobian(r, top), -ca.substitute(r, top, ca.SX.zeros(system.n)))
    velocity = [v[i] if s else solved[i] for i, s in enumerate(system.second_order)]
    return state_of(system, ca.vertcat(*velocity), solved)


def state_of(system: System, q: ca.SX, v: ca.SX) -> ca.SX:
    """Return the entries q of all coordinates, then those of v of the second-order ones."""
    return ca.vertcat(q, *(v[i] for i, s in enumerate(system.second_order) if s))


def linear_matrices(residual: ca.Function) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return mass, damping and stiffness, functions of p: derivatives of the residual (q, v, a, p) at rest."""
    n, n_p = residual.size1_in(0), residual.size1_in(3)
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, n_p), strict=True))
    r = residual(q, v, a, p)
    qva, zero = ca.vertcat(q, v, a), ca.SX.zeros(3 * n)
    at_rest = [ca.substitute(ca.jacobian(r, s), qva, zero) for s in (a, v, q)]
    at_rest = [ca.sparsify(ca.simplify(m)) for m in at_rest]
    return tuple(ca.Function(name, [p], [m]) for name, m in zip(("M", "D", "K"), at_rest, strict=True))  # type: ignore[return-value]
