"""Equations of cycles with given values of the conserved quantities of their system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.methods.equations import Equations
from hbbogie.model.conserved import ZERO, conserved_along, expression
from hbbogie.once import Once
from hbbogie.results import Orbit

Array = NDArray[np.float64]
SAMPLES = 12


def within_level(equations: Equations, orbit: Orbit) -> Equations:
    """Return equations whose solutions have the same means of the conserved quantities as an orbit.

    If a quantity is conserved, one equation of the means follows from the others, and cycles form families. That
    equation is replaced by the value of the conserved quantity. Equations of systems that conserve nothing are returned
    unchanged.

    Parameters
    ----------
    equations : Equations
    orbit : Orbit
        The orbit that gives the values, at its own parameter values.
    """
    system = equations.system
    if equations.phase is None or orbit.coordinates != system.coordinate_names:
        return equations
    size = np.abs(orbit.coefficients).sum(axis=0)
    rows = conserved_along(system, orbit, system.vector())[:, : system.n]
    rows = rows[np.abs(rows).max(axis=1, initial=0.0) > 0]
    places = _dependent(equations, orbit, len(rows)) if len(rows) else np.empty(0, dtype=int)
    if not len(places) or len(places) != len(rows):
        return equations
    return _at_level(equations, places, rows, rows @ orbit.coefficients[0], size)


def within_family(equations: Equations, orbit: Orbit, level: float, **fixed: float) -> Equations:
    """Return equations of the one cycle of a family that has a given level (eq-family).

    Where something is conserved, whether it is known or not, one combination of the equations follows from the others
    at every cycle. The one with the least singular value at the orbit is replaced by the level, which is the cosine of
    the first harmonic of the coordinate that sets the phase, or the frequency where coordinates run on. That the
    combination is zero at a solution must be checked with the equations themselves: where nothing is conserved it is
    not.

    Parameters
    ----------
    equations : Equations
        Of cycles.
    orbit : Orbit
        Near the cycle.
    level : float, unit of the coordinate or rad/s
    **fixed : float
        Parameter values.
    """
    m = equations.size
    place = m - 1 if equations.leading is None else equations.leading
    z, p = equations.encode(orbit), equations.system.vector(**fixed)
    J = equations.derivatives(())(z, p)[1].full() / equations.residual_scale[:, None] * equations.scale
    psi = np.linalg.svd(J)[0][:, -1]
    kept = np.eye(m) - np.outer(psi * equations.residual_scale, psi / equations.residual_scale)
    slopes, weights = np.zeros((m, m)), psi * equations.residual_scale / equations.scale[place]
    slopes[:, place] = weights
    return _replaced(equations, ca.DM(kept), slopes, weights * level, equations.residual_scale, equations.rows)


def _dependent(equations: Equations, orbit: Orbit, count: int) -> NDArray[np.int_]:
    """Return the places of ``count`` equations of means that follow from the others, whatever the unknowns."""
    means = np.array([i for i, row in enumerate(equations.rows) if row.endswith(", mean")], dtype=int)
    if not len(means):
        return means
    rng = np.random.default_rng(1995)
    z, p = equations.encode(orbit), equations.system.vector()
    spread = np.where(np.abs(z) > 0, np.abs(z), 0.1 * np.abs(z).max())
    spread[-1] = 0.0  # the frequency
    F = np.array(
        [
            equations.residual(z + 0.3 * spread * rng.standard_normal(len(z)), p).full().ravel()[means]
            for _ in range(SAMPLES)
        ]
    ).T
    F = F[:, np.isfinite(F).all(axis=0)] / equations.residual_scale[means, None]
    if F.shape[1] < len(means):
        return means[:0]
    U, s, _ = np.linalg.svd(F)
    null = U[:, s <= 1e3 * ZERO * max(float(s[0]), 1e-300)]
    if null.shape[1] < count:
        return means[:0]
    chosen: list[int] = []
    for _ in range(count):  # the equations with the largest weights
        i = int(np.argmax(np.abs(null).max(axis=1)))
        chosen.append(i)
        j = int(np.argmax(np.abs(null[i])))
        null = null - np.outer(null[:, j], null[i] / null[i, j])
    return means[chosen]


def _at_level(equations: Equations, places: NDArray[np.int_], rows: Array, held: Array, size: Array) -> Equations:
    """Return the equations with some replaced by values of conserved quantities, which are linear in the means."""
    m, names = equations.size, equations.system.coordinate_names
    kept, slopes = np.ones(m), np.zeros((m, m))
    kept[places] = 0.0
    # the mean of an angle that sets the phase is zero and no unknown
    known = [k for k, name in enumerate(names) if f"{name}, mean" in equations.unknowns]
    means = np.array([equations.unknowns.index(f"{names[k]}, mean") for k in known], dtype=int)
    slopes[np.ix_(places, means)] = rows[:, known]
    offset = np.zeros(m)
    offset[places] = held
    sizes, labels = np.abs(rows) @ size, list(equations.rows)
    residual_scale = equations.residual_scale.copy()
    residual_scale[places] = np.where(sizes > 0, sizes, 1.0)
    for place, row in zip(places, rows, strict=True):
        labels[place] = f"level of {expression(row, names)}"
    return _replaced(equations, ca.diag(ca.DM(kept)), slopes, offset, residual_scale, tuple(labels))


def _replaced(
    equations: Equations, kept: ca.DM, slopes: Array, offset: Array, residual_scale: Array, rows: tuple[str, ...]
) -> Equations:
    """Return the equations kept F + slopes z - offset = 0."""
    m, once = equations.size, Once()
    z, p = ca.MX.sym("z", m), ca.MX.sym("p", equations.residual.size1_in(1))
    multipliers = ca.MX.sym("multipliers", m)
    level = ca.mtimes(ca.DM(slopes), z) - offset

    def derivatives(free: tuple[int, ...]) -> ca.Function:
        def build() -> ca.Function:
            F, J = equations.derivatives(free)(z, p)
            J = ca.mtimes(kept, J) + np.hstack([slopes, np.zeros((m, len(free)))])
            return ca.Function("dF", [z, p], [ca.mtimes(kept, F) + level, ca.densify(J)], ["z", "p"], ["F", "J"])

        return once(("derivatives", free), build)

    def pulled(key: object, function: Callable[[], ca.Function], output: str, *more: ca.MX) -> ca.Function:
        """Return a function of the multipliers, to which the added linear equations contribute nothing."""
        inputs = [z, p, multipliers, *more]
        names = ["z", "p", "multipliers", *(["direction"] * len(more))]
        pull = ca.mtimes(kept.T, multipliers)
        return once(key, lambda: ca.Function(output, inputs, [function()(z, p, pull, *more)], names, [output]))

    return replace(
        equations,
        residual=ca.Function("F", [z, p], [ca.mtimes(kept, equations.residual(z, p)) + level]),
        derivatives=derivatives,
        hessian=lambda free: pulled(("hessian", free), lambda: equations.hessian(free), "H"),
        hessian_times=lambda free: pulled(
            ("hessian_times", free),
            lambda: equations.hessian_times(free),
            "H",
            ca.MX.sym("direction", m + len(free)),
        ),
        sensitivity=lambda: pulled("sensitivity", equations.sensitivity, "L_p"),
        rows=rows,
        residual_scale=residual_scale,
        with_phase=None,
        once=once,
    )
