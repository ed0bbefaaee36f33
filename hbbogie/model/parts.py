"""Symbolic analysis of equations of motion: checks, linear part, nonlinear coordinates, symmetry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.model.dynamics import Dynamics, linear_matrices
from hbbogie.model.elements import AttachedLaw

SMALLEST_SPREAD = 1e-100  # of a jump, in the unit of the argument: none where the argument rests


@dataclass(frozen=True, eq=False, kw_only=True)
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

    __repr__ = brief


def split(system: Dynamics, contact: bool, *, every_law: bool = False, running: tuple[int, ...] = ()) -> Parts:
    """Take equations of motion apart.

    Parameters
    ----------
    system : Dynamics
    contact : bool
        Whether continuous piecewise-linear elements are kept apart as contacts; otherwise they go to the remainder.
    every_law : bool
        Whether all elements are kept apart, whatever their law.
    running : tuple of int
        Coordinates that run on: a nonlinear equation has no stiffness in them, since only the whole is periodic.
    """
    n = system.n
    q, v, a, p = system.symbols()
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
    bent = [i for i, nonlinear in enumerate(ca.which_depends(r, qva, 2, False)) if nonlinear or i in running]
    rest = ca.SX.zeros(3 * n)
    only = ca.vertcat(*(qva[i] if i in bent else ca.SX(0) for i in range(3 * n)))
    r_only = ca.substitute(r, qva, only)
    constant = ca.substitute(r, qva, rest)
    hessian_rows = {i for i in range(n) if bent and any(ca.which_depends(r[i], qva, 2, False))}
    if running:
        stiffness = K(p)
        stiffness[sorted(hessian_rows), list(running)] = 0
        K = ca.Function("K", [p], [ca.sparsify(stiffness)])
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
        mass=M,
        damping=D,
        stiffness=K,
        remainder=ca.Function("remainder", [q, v, a, p, dt], [ca.densify(remainder)], [*"qvap", "dt"], ["r"]),
        remainder_rows=rows,
        contacts=contacts,
        directions=ca.Function("B", [p], [ca.sparsify(B[:, exact])]),
        nonlinear=tuple(sorted(nonlinear)),
    )


def _spread(element: AttachedLaw, q: ca.SX, v: ca.SX, a: ca.SX, p: ca.SX, dt: ca.SX) -> ca.SX:
    """Return the force of an element that jumps, its jumps spread over the time dt (eq-spread)."""
    u = element.argument(q, v, p)
    rate = ca.jtimes(u, ca.vertcat(q, v), ca.vertcat(v, a))
    return element.at(p).ramps().force(u, spread=ca.fmax(ca.fabs(rate) * dt, SMALLEST_SPREAD))  # type: ignore[union-attr]


def is_odd(system: Dynamics, values: NDArray[np.float64], spread: float = 0.0, trials: int = 60) -> bool:
    """Test the identity r(-x, p) = -r(x, p) at random states and parameter values.

    The magnitude of the states runs over nine decades, so that every piece of a piecewise law is met;
    the parameters are taken within their bounds, about the values given (about 1 where a value is 0), up to the
    relative distance ``spread``: with 0 the identity is tested at the values themselves.
    """
    rng = np.random.default_rng(1995)
    n = system.n
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


def _largest_term(system: Dynamics, x: list[Any], p: Any) -> Any:
    """Return the size of the largest linear term of the equations at each trial, shape (1, trials)."""
    q, v, a = x
    trials = q.shape[1]
    M, D, K = (np.abs(f.map(trials)(p).full().reshape(system.n, trials, system.n)) for f in system.linear)
    return sum(np.einsum("itj,jt->it", matrix, np.abs(s)) for matrix, s in ((M, a), (D, v), (K, q))).max(
        axis=0, keepdims=True
    )
