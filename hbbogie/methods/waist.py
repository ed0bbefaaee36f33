"""The waist of the balance methods: their functions with labels, bounds and scales."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hbbogie.analysis import Parts
from hbbogie.equations import Equations
from hbbogie.methods.assembly import Assembly
from hbbogie.methods.condensation import frequency_scale
from hbbogie.methods.layout import Layout
from hbbogie.system import System

Array = NDArray[np.float64]
SMALLEST, LARGEST = 1e-5, 1e3  # bounds of the unknowns, in units of their scale


def make_equations(system: System, assembly: Assembly, method: str) -> Equations:
    """Return the equations with bounds and scales at the system's parameter values.

    Parameters
    ----------
    system : System
    assembly : Assembly
    method : str
        What made them, for people.
    """
    layout, p = assembly.layout, system.vector()
    size, omega = _amplitude_scale(layout.parts, p), frequency_scale(system, p) if layout.moving else 0.0
    scale = np.full(layout.size, size)
    lower, upper = -LARGEST * scale, LARGEST * scale
    if layout.phase is not None:
        scale[-1], lower[-1], upper[-1] = omega, omega * 1e-3, omega * 1e3
        lower[layout.S.index(layout.phase) * layout.waves] = SMALLEST * size
    rows = _row_scale(layout.parts, p, omega) * size
    means = rows if layout.means else np.empty(0)
    return Equations(
        system,
        method,
        assembly.residual,
        assembly.derivatives,
        assembly.hessian,
        assembly.sensitivity,
        assembly.coefficients,
        assembly.frequency,
        layout.from_coefficients,
        _labels(system, layout, layout.S, "unknown"),
        _labels(system, layout, assembly.R, "equation"),
        lower,
        upper,
        scale,
        np.r_[np.repeat(rows[list(assembly.R)], layout.waves), means],
        layout.phase,
        assembly.built,
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
    means = [f"{prefix}{c}, mean" for c in name] if layout.means else []
    return (*moving, *means, *(["omega"] if kind == "unknown" and layout.moving else []))


def _amplitude_scale(parts: Parts, p: Array) -> float:
    """Return a typical amplitude: the smallest gap of the contact elements, else 1."""
    gaps = [abs(g) for e in parts.contacts if e.ramps for g in e.ramps(p)[3].full().ravel() if g != 0]
    return float(min(gaps, default=1.0))


def _row_scale(parts: Parts, p: Array, omega: float) -> Array:
    """Return a typical size of each equation per unit amplitude, shape (n,)."""
    M, D, K = (np.abs(f(p).full()) for f in (parts.mass, parts.damping, parts.stiffness))
    rows = (M * omega**2 + D * omega + K).sum(axis=1)
    return np.where(rows > 0, rows, 1.0)
