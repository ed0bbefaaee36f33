"""The equations of the balance methods: their functions with labels, bounds and scales."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hbbogie.methods.assembly import Assembly
from hbbogie.methods.condensation import frequency_scale
from hbbogie.methods.equations import Equations
from hbbogie.methods.layout import Layout
from hbbogie.methods.sparse_assembly import SparseAssembly
from hbbogie.model.parts import Parts
from hbbogie.model.system import System

Array = NDArray[np.float64]
SMALLEST, LARGEST = 1e-5, 1e3  # bounds of the unknowns, in units of their scale


def make_equations(system: System, assembly: Assembly | SparseAssembly, method: str) -> Equations:
    """Return the equations with bounds and scales at the system's parameter values.

    Parameters
    ----------
    system : System
    assembly : Assembly or SparseAssembly
    method : str
        Description of the method, for messages.
    """
    layout, p = assembly.layout, system.vector()
    omega = frequency_scale(system, p)
    size, omega = amplitude_scale(layout.parts, p, omega), omega if layout.moving else 0.0
    scale = np.full(layout.size, size)
    lower, upper = -LARGEST * scale, LARGEST * scale
    if layout.phase is not None:
        scale[-1], lower[-1], upper[-1] = omega, omega * 1e-3, omega * 1e3
        if not layout.advance:
            lower[layout.cosines[layout.phase]] = SMALLEST * size
    rows = _row_scale(layout.parts, p, omega) * size
    means = np.empty(0) if layout.odd else rows
    return Equations(
        system=system,
        method=method,
        residual=assembly.residual,
        derivatives=assembly.derivatives,
        hessian=assembly.hessian,
        hessian_times=assembly.hessian_times,
        sensitivity=assembly.sensitivity,
        coefficients=assembly.coefficients,
        frequency=assembly.frequency,
        from_coefficients=layout.from_coefficients,
        unknowns=_labels(system, layout, layout.S, "unknown"),
        rows=_labels(system, layout, assembly.R, "equation"),
        lower=lower,
        upper=upper,
        scale=scale,
        residual_scale=np.r_[np.repeat(rows[list(assembly.R)], layout.waves), means],
        phase=layout.phase,
        advance=layout.advance,
        cosines=layout.cosines,
        once=assembly.once,
    )


def _labels(system: System, layout: Layout, which: Sequence[int], kind: str) -> tuple[str, ...]:
    name = system.coordinate_names
    prefix = "equation of " if kind == "equation" else ""
    moving = [
        f"{prefix}{name[i]}, {wave} of harmonic {h}"
        for i in which
        for h in layout.moving
        for wave in ("cosine", "sine")
    ]
    if kind == "unknown":
        moving = [moving[k] for k in layout.keep]
    which = layout.means if kind == "unknown" or layout.odd else range(layout.n)
    means = [f"{prefix}{name[i]}, mean" for i in which]
    return (*moving, *means, *(["omega"] if kind == "unknown" and layout.moving else []))


def amplitude_scale(parts: Parts, p: Array, omega: float) -> float:
    """Return a typical amplitude: the smallest gap of the contact elements, or where a smooth force becomes nonlinear.

    The latter is the power of ten nearest to the amplitude at which the nonlinear part of an equation is half as large
    as the linear one, with all coordinates moving alike at the frequency omega. It is 1 if there is no such amplitude.
    """
    thresholds = [np.abs(e.gaps(p)) for e in parts.contacts]
    gaps = [g for t in thresholds for g in t if 0 < g < np.inf]
    if gaps or not parts.remainder_rows:
        return float(min(gaps, default=1.0))
    n, rows = parts.mass.size1_out(0), list(parts.remainder_rows)
    M, D, K = (np.abs(f(p).full())[rows].sum(axis=1) for f in (parts.mass, parts.damping, parts.stiffness))
    linear = M * omega**2 + D * omega + K
    sizes, turns = np.logspace(-12, 12, 97), np.linspace(0, 2 * np.pi, 16, endpoint=False)
    A, tau = (x.ravel() for x in np.meshgrid(sizes, turns, indexing="ij"))
    motion = [np.tile(A * np.cos(tau + k * np.pi / 2) * omega**k, (n, 1)) for k in range(3)]
    force = np.array(parts.remainder.map(len(A))(*motion, np.tile(p[:, None], len(A)), 0.0))[rows]
    at_rest = np.array(parts.remainder(*np.zeros((3, n)), p, 0.0))[rows]
    force = np.abs(force - at_rest).reshape(len(rows), len(sizes), -1).max(axis=2)
    with np.errstate(invalid="ignore"):
        bent = (force >= 0.5 * linear[:, None] * sizes).any(axis=0) & np.isfinite(force).all(axis=0)
    if not bent.any() or bent[0]:
        return 1.0
    return float(10.0 ** np.round(np.log10(sizes[np.argmax(bent)])))


def _row_scale(parts: Parts, p: Array, omega: float) -> Array:
    """Return a typical size of each equation per unit amplitude, shape (n,)."""
    M, D, K = (np.abs(f(p).full()) for f in (parts.mass, parts.damping, parts.stiffness))
    rows = (M * omega**2 + D * omega + K).sum(axis=1)
    return np.where(rows > 0, rows, 1.0)
