"""Symbolic analysis of equations of motion: checks, linear part, nonlinear coordinates, symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError

if TYPE_CHECKING:
    from hbbogie.elements import AttachedLaw, Element
    from hbbogie.system import Coordinate, Parameter, System

SMALLEST_SPREAD = 1e-100  # of a jump, in the unit of the argument: none where the argument rests


def check_names(
    coordinates: Sequence[Coordinate], parameters: Sequence[Parameter], elements: Sequence[Element]
) -> None:
    """Raise `ModelError` unless there are coordinates and all names differ."""
    if not coordinates:
        raise ModelError("a system needs at least one coordinate; got none.")
    for kind, things, constructor in (
        ("coordinates", coordinates, "Coordinate"),
        ("parameters", parameters, "Parameter"),
        ("elements", elements, "Element"),
    ):
        for thing in things:
            if type(thing).__name__ != constructor:
                raise ModelError(f"{kind}: got a {type(thing).__name__}; make it with {constructor}(name, ...).")
    names = [str(thing.name) for group in (coordinates, parameters, elements) for thing in group]
    doubles = sorted({name for name in names if names.count(name) > 1})
    if doubles:
        raise ModelError(f"each name may be used once; got twice or more: {', '.join(doubles)}.")


def check_equations(
    equations: Sequence[Any],
    coordinates: Sequence[Coordinate],
    parameters: Sequence[Parameter],
    elements: Sequence[Element],
) -> ca.SX:
    """Return the equations as a vector; raise `ModelError` when they cannot be meant."""
    n = len(coordinates)
    rows = [ca.SX(e) for e in equations]
    for i, row in enumerate(rows):
        if not row.is_scalar():
            raise ModelError(f"equation {i + 1} has shape {row.shape}; each equation is one scalar expression.")
    if len(rows) != n:
        raise ModelError(f"got {len(rows)} equations for {n} coordinates; give one equation for each coordinate.")
    motion = [s for c in coordinates for s in (c, c.dot, c.ddot)]
    known = {s.element_hash() for s in [*motion, *parameters, *elements]}
    moving = {s.element_hash() for s in [*motion, *elements]}
    for i, row in enumerate(rows):
        symbols = ca.symvar(row)
        strangers = [s.name() for s in symbols if s.element_hash() not in known]
        if strangers:
            raise ModelError(
                f"equation {i + 1} contains {', '.join(strangers)}, which is no coordinate, parameter or element of "
                "the system; list it in coordinates=, parameters= or elements=."
            )
        if not any(s.element_hash() in moving for s in symbols):
            raise ModelError(f"equation {i + 1} ({row}) contains no coordinate; every equation must contain one.")
    for element in elements:
        strangers = [
            s.name()
            for s in ca.symvar(ca.vertcat(element.argument, ca.SX(element.law.force(element.argument))))
            if s.element_hash() not in known
        ]
        if strangers:
            raise ModelError(
                f"element {element.name!r} contains {', '.join(strangers)}, which is no coordinate or parameter of the "
                "system; list it in coordinates= or parameters=."
            )
    used = {s.element_hash() for row in rows for s in ca.symvar(row)}
    for element in elements:
        if element.element_hash() not in used:
            raise ModelError(f"element {element.name!r} stands in no equation; add its force to one.")
    if any(np.isnan(np.asarray(ca.DM(c))).any() for row in rows for c in _constants(row)):
        raise ModelError("an equation contains a constant that is not a number (NaN); check the numbers used.")
    return ca.vertcat(*rows)


def _constants(row: ca.SX) -> list[float]:
    f = ca.Function("row", ca.symvar(row), [row])
    return [f.instruction_constant(k) for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST]


def orders(residual: ca.Function, coordinates: Sequence[Coordinate]) -> tuple[bool, ...]:
    """Return for each coordinate whether its second derivative occurs (else its first must)."""
    rates, accelerations = (set(residual.jac_sparsity(0, i).get_col()) for i in (1, 2))
    for i, c in enumerate(coordinates):
        if i not in rates and i not in accelerations:
            raise ModelError(
                f"neither velocity nor acceleration of coordinate {c.name!r} occurs in the equations; eliminate it "
                "by hand, or give it mass or damping."
            )
    return tuple(i in accelerations for i in range(len(coordinates)))


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


@dataclass(frozen=True, eq=False)
class Parts:
    """A system taken apart for harmonic balance: r = M a + D v + K q + remainder + B contact forces.

    Attributes
    ----------
    mass, damping, stiffness : casadi.Function, p -> (n, n)
    remainder : casadi.Function, (q, v, a, p, dt) -> (n,)
        All that is nonlinear or constant, without the contact elements; jumps are spread over the time dt [s].
    remainder_rows : tuple of int
        Equations in which the remainder is not zero.
    contacts : tuple of AttachedLaw
        Piecewise-linear elements to be integrated between their contact times.
    directions : casadi.Function, p -> (n, number of contacts)
        B: how the contact forces enter the equations.
    nonlinear : tuple of int
        The coordinates that enter the remainder or a contact.
    """

    mass: ca.Function
    damping: ca.Function
    stiffness: ca.Function
    remainder: ca.Function
    remainder_rows: tuple[int, ...]
    contacts: tuple[AttachedLaw, ...]
    directions: ca.Function
    nonlinear: tuple[int, ...]


def split(system: System, contact: bool, *, every_law: bool = False) -> Parts:
    """Take a system apart.

    Parameters
    ----------
    system : System
    contact : bool
        Whether continuous piecewise-linear elements are kept apart as contacts; otherwise they go to the remainder.
    every_law : bool
        Whether all elements are kept apart, whatever their law.
    """
    n = system.n
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, len(system.parameters)), strict=True))
    qva, dt = ca.vertcat(q, v, a), ca.SX.sym("dt")
    f = ca.SX.sym("f", len(system.elements))
    r_f = system.residual_with_forces(q, v, a, f, p)
    B = ca.jacobian(r_f, f)
    exact = [
        i
        for i, e in enumerate(system.elements)
        if (every_law or (contact and e.ramps is not None and e.heights is None))
        and not ca.depends_on(B[:, i], ca.vertcat(qva, f))
    ]
    forces = [ca.SX(0) if i in exact else e.force(e.argument(q, v, p), p) for i, e in enumerate(system.elements)]
    r = ca.substitute(r_f, f, ca.vertcat(*forces)) if forces else r_f
    without = ca.Function("r", [q, v, a, p], [r])
    M, D, K = linear_matrices(without)
    jumping = [i for i, e in enumerate(system.elements) if e.heights is not None and i not in exact]
    if jumping:  # else the derivatives would not see the jumps
        for i in jumping:
            forces[i] = _spread(system.elements[i], q, v, a, p, dt)
        r = ca.substitute(r_f, f, ca.vertcat(*forces))
    # remainder = r - linear part; entries that are linear drop out by their sparsity, not by subtraction
    bent = [i for i, nonlinear in enumerate(ca.which_depends(r, qva, 2, False)) if nonlinear]
    rest = ca.SX.zeros(3 * n)
    only = ca.vertcat(*(qva[i] if i in bent else ca.SX(0) for i in range(3 * n)))
    r_only = ca.substitute(r, qva, only)
    constant = ca.substitute(r, qva, rest)
    hessian_rows = {i for i in range(n) if bent and any(ca.which_depends(r[i], qva, 2, False))}
    linear = M(p) @ only[2 * n :] + D(p) @ only[n : 2 * n] + K(p) @ only[:n]
    remainder = ca.vertcat(*(r_only[i] - linear[i] if i in hessian_rows else constant[i] for i in range(n)))
    remainder = ca.sparsify(ca.simplify(remainder))
    rows = tuple(sorted(set(remainder.sparsity().row())))
    contacts = tuple(system.elements[i] for i in exact)
    nonlinear = {i % n for i in bent}
    for e in contacts:
        u = e.argument(q, v, p)
        nonlinear |= {i % n for i, d in enumerate(ca.which_depends(u, ca.vertcat(q, v), 1, False)) if d}
    return Parts(
        M, D, K,
        ca.Function("remainder", [q, v, a, p, dt], [ca.densify(remainder)], ["q", "v", "a", "p", "dt"], ["r"]),
        rows,
        contacts,
        ca.Function("B", [p], [ca.sparsify(B[:, exact])]),
        tuple(sorted(nonlinear)),
    )  # fmt: skip


def _spread(element: AttachedLaw, q: ca.SX, v: ca.SX, a: ca.SX, p: ca.SX, dt: ca.SX) -> ca.SX:
    """Return the force of an element that jumps, its jumps spread over the time dt (eq-spread)."""
    u = element.argument(q, v, p)
    rate = ca.jtimes(u, ca.vertcat(q, v), ca.vertcat(v, a))
    return element.at(p).ramps().force(u, spread=ca.fmax(ca.fabs(rate) * dt, SMALLEST_SPREAD))  # type: ignore[union-attr]


def is_odd(system: System, trials: int = 60, spread: float = 0.4) -> bool:
    """Test the identity r(-x, p) = -r(x, p) at random states and parameter values.

    The magnitude of the states runs over nine decades, so that every piece of a piecewise law is met;
    the parameters are taken within their bounds, about their values (about 1 where the value is 0), up to the
    relative distance ``spread``: with 0 the identity is tested at the values themselves.
    """
    rng = np.random.default_rng(1995)
    n, values = system.n, system.vector()
    low, high = (np.array([p.bounds[k] for p in system.parameters]) for k in (0, 1))
    shape = (n, trials)
    x = [rng.standard_normal(shape) * 10.0 ** rng.uniform(-5, 4, (1, trials)) for _ in range(3)]
    reach = spread * np.where(values == 0, 1.0, np.abs(values))[:, None]
    p = np.clip(values[:, None] + reach * rng.uniform(-1, 1, (len(values), trials)), low[:, None], high[:, None])
    plus, minus = (system.residual.map(trials)(*(s * xi for xi in x), p).full() for s in (1.0, -1.0))
    finite = np.isfinite(plus) & np.isfinite(minus)
    size = np.maximum(np.abs(plus), np.abs(minus)).max(axis=0, keepdims=True)
    # the terms of a sum may cancel: compare with the largest term, not with the sum
    terms = _largest_term(system, x, p)
    return bool(finite.all() and (np.abs(plus + minus) <= 1e-11 * np.maximum(size, terms)).all())


def _largest_term(system: System, x: list[Any], p: Any) -> Any:
    """Return the size of the largest linear term of the equations at each trial, shape (1, trials)."""
    q, v, a = x
    trials = q.shape[1]
    M, D, K = (np.abs(f.map(trials)(p).full().reshape(system.n, trials, system.n)) for f in system.linear)
    return sum(np.einsum("itj,jt->it", matrix, np.abs(s)) for matrix, s in ((M, a), (D, v), (K, q))).max(
        axis=0, keepdims=True
    )
