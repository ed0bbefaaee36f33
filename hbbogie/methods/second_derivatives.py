"""Derivatives of multipliers . F: in all parameters, and second ones in the unknowns, all or times a direction.

They follow the two stages of `hbbogie.methods.assembly`. The second stage is linear in the coefficients of the first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from hbbogie.methods.assembly import Assembly, Gains


def sensitivity(assembly: Assembly) -> ca.Function:
    """Return (z, p, multipliers) -> derivative of multipliers . F with respect to all parameters."""
    sx, L = _lagrangian(assembly)
    on_p = ca.Function("stage_slopes", sx, [ca.densify(ca.gradient(L, sx[1]))])  # one sweep, no Jacobian
    (z, p, multipliers), _, pull_c, c, pulls = _first_stage(assembly)
    L_p = on_p(z, p, c, multipliers, pulls)
    if assembly.layout.parts.remainder_rows:
        slopes = assembly.sampling.jacobian(z, p, tuple(range(assembly.n_p)))[:, assembly.layout.size :]
        L_p = L_p + ca.mtimes(slopes.T, ca.vec(pull_c[:, assembly.ramps :]))
    return ca.Function("sensitivity", [z, p, multipliers], [L_p], ["z", "p", "multipliers"], ["L_p"])


def hessian(assembly: Assembly, free: tuple[int, ...]) -> ca.Function:
    """Return (z, p, multipliers) -> second derivative of multipliers . F with respect to (z, p[free])."""
    sx, L = _lagrangian(assembly)
    y = ca.vertcat(sx[0], *(sx[1][i] for i in free))
    L_c = ca.vec(_pulls(assembly)(sx[0], sx[1], sx[3]))
    second = ca.Function("stage_hessian", sx, [ca.hessian(L, y)[0], ca.jacobian(L_c, y)])
    (z, p, multipliers), gains, pull_c, c, pulls = _first_stage(assembly)
    H, H_c = second(z, p, c, multipliers, pulls)
    c_y, W = assembly.first_stage_jacobian(z, p, gains, free)
    cross = ca.mtimes(H_c.T, c_y)
    H = H + cross + cross.T
    for i, (slope, (_, _, times, weights)) in enumerate(zip(W, gains, strict=True)):
        Q = assembly.ramp.curvature(times, weights, pull_c[:, i])
        H = H + ca.mtimes(slope.T, ca.mtimes(Q, slope))  # the contact times move with w (eq-contact-hessian)
    if assembly.layout.parts.remainder_rows:
        H = H + assembly.sampling.hessian(free)(z, p, ca.vec(pull_c[:, assembly.ramps :]))
    return ca.Function("hessian", [z, p, multipliers], [H], ["z", "p", "multipliers"], ["H"])


def hessian_times(assembly: Assembly, free: tuple[int, ...]) -> ca.Function:
    """Return (z, p, multipliers, direction) -> second derivative of multipliers . F times a direction of (z, p[free]).

    Each term of `hessian` is a derivative of a gradient along the direction: a few sweeps, no second Jacobian.
    """
    sx, L = _lagrangian(assembly)
    y = ca.vertcat(sx[0], *(sx[1][i] for i in free))
    L_c = ca.vec(_pulls(assembly)(sx[0], sx[1], sx[3]))
    d, d_c = ca.SX.sym("direction", y.shape[0]), ca.SX.sym("d_c", L_c.shape[0])
    along = ca.jtimes(ca.gradient(L, y), y, d) + ca.jtimes(L_c, y, d_c, True)
    second = ca.Function("stage_hessian_times", [*sx, d, d_c], list(map(ca.densify, (along, ca.jtimes(L_c, y, d)))))
    (z, p, multipliers), gains, pull_c, c, pulls = _first_stage(assembly)
    direction = ca.MX.sym("direction", y.shape[0])
    c_y, W = assembly.first_stage_jacobian(z, p, gains, free)
    H, H_c = second(z, p, c, multipliers, pulls, direction, ca.mtimes(c_y, direction))
    H = H + ca.mtimes(c_y.T, H_c)
    for i, (slope, (_, _, times, weights)) in enumerate(zip(W, gains, strict=True)):
        Q = assembly.ramp.curvature(times, weights, pull_c[:, i])
        H = H + ca.mtimes(slope.T, ca.mtimes(Q, ca.mtimes(slope, direction)))
    if assembly.layout.parts.remainder_rows:
        H = H + assembly.sampling.hessian_times(free)(z, p, ca.vec(pull_c[:, assembly.ramps :]), direction)
    inputs = [z, p, multipliers, direction]
    return ca.Function("hessian_times", inputs, [H], ["z", "p", "multipliers", "direction"], ["H"])


def _lagrangian(assembly: Assembly) -> tuple[list[ca.SX], ca.SX]:
    """Return [z, p, c, multipliers, pulls], and multipliers . F plus pulls . inputs of the ramps.

    ``pulls`` has the shape of the inputs and is the derivative of multipliers . F in each of them.
    """
    sx, lam = assembly.stage_symbols(), ca.SX.sym("multipliers", assembly.layout.size)
    pulls = ca.SX.sym("pulls", *assembly.inputs.size_out(0))
    L = ca.dot(lam, assembly.stage(*sx)) + ca.dot(pulls, assembly.inputs(*sx[:2]))
    return [*sx, lam, pulls], L


def _pulls(assembly: Assembly) -> ca.Function:
    """Return (z, p, multipliers) -> derivative of multipliers . F in the coefficients of the first stage."""

    def build() -> ca.Function:
        (z, p, c, lam, _), L = _lagrangian(assembly)
        return ca.Function("pulls", [z, p, lam], [ca.densify(ca.gradient(L, c))])

    found: ca.Function = assembly.once("pulls", build)
    return found


def _first_stage(assembly: Assembly) -> tuple[list[ca.MX], Gains, ca.MX, ca.MX, ca.MX]:
    """Return [z, p, multipliers], the ramps' gains, the pulls on all coefficients, these, and those on the inputs."""
    z, p = ca.MX.sym("z", assembly.layout.size), ca.MX.sym("p", assembly.n_p)
    multipliers, gains = ca.MX.sym("multipliers", assembly.layout.size), assembly.gains(z, p)
    pull_c = _pulls(assembly)(z, p, multipliers)
    columns = [ca.mtimes(G.T, pull_c[:, i]) for i, (_, G, _, _) in enumerate(gains)]
    pulls = ca.horzcat(*columns) if columns else ca.MX.zeros(*assembly.inputs.size_out(0))
    return [z, p, multipliers], gains, pull_c, assembly.first_stage(z, p, gains), pulls
