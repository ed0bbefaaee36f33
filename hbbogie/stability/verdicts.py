"""Verdicts on cycles from their maps: which multiplier is the trivial one, and on which side the others are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.model.conserved import expression
from hbbogie.results import Stability

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

MARGIN = 5.0  # distance from the unit circle, in errors of the trivial multiplier, beyond which the side is certain
CANDIDATES = 0.3  # distance from 1 up to which a multiplier may be the trivial one
ALIGNED = 0.999  # ratio of cosines of angles with the motion's direction above which they count as equal
ZERO = float(np.log(np.finfo(float).eps))  # logarithm of a multiplier that is none
NEUTRAL = "neutral as far as can be told"  # what the reason says where multipliers are on the unit circle


@dataclass(frozen=True, eq=False)
class Motion:
    """What is known about a cycle besides its map.

    Attributes
    ----------
    rate : ndarray, shape (n_states,)
        dx/dt where the map begins: the direction of the trivial multiplier.
    size : ndarray, shape (n_states,)
        Size of each state.
    conserved : ndarray, shape (k, n_states)
        Rows w with w . x constant along every motion.
    names : tuple of str
        Of the states.
    """

    rate: Array
    size: Array
    conserved: Array
    names: tuple[str, ...]


def judge(
    matrix: Array, parts: int, log_det: float, trace: float, tolerance: float, motion: Motion | None = None
) -> Stability:
    """Return the verdict on a cycle from its map and from Liouville's formula.

    If linear quantities are conserved, there is one multiplier 1 for each of them, besides the trivial one. The cycle
    is then judged among motions with the same values of these quantities, by the map restricted to disturbances that do
    not change them.

    Parameters
    ----------
    matrix : ndarray, shape (n_states, n_states)
        The monodromy matrix (parts = 1), or G, whose square it is (parts = 2).
    parts : int
    log_det, trace : float
        Over the full period: log abs det accumulated over the mesh, and the integral of the trace.
    tolerance : float
        Largest error of the trivial multiplier, and of the logarithm of the determinant relative to its size.
    motion : Motion, optional
        Used to distinguish the trivial multiplier from others near 1.
    """
    k = 0 if motion is None else len(motion.conserved)
    level = np.eye(len(matrix))
    if motion is not None and k:  # an orthonormal basis of the disturbances that conserve, in states of size 1
        size = np.where(motion.size > 0, motion.size, 1.0)
        level = np.linalg.svd(motion.conserved * size)[2][k:].T
        matrix = level.T @ (matrix / size[:, None] * size) @ level
        level = size[:, None] * level
    values, vectors = np.linalg.eig(matrix)
    order = np.argsort(-np.abs(values), kind="stable")
    values, vectors = values[order].astype(complex), level @ vectors[:, order]
    trivial = int(np.argmin(np.abs(values - 1)))
    if motion is not None:
        trivial = trivial_of(values, vectors, motion.rate, motion.size)
    multipliers = values**parts
    if len(values) == 2:  # the determinant is the other one, which is zero below round-off
        log_det, trace = max(log_det, ZERO), max(trace, ZERO)
    error, liouville = float(abs(multipliers[trivial] - 1)), abs(log_det - trace) / max(1.0, abs(trace))
    doubt = ""
    if not error <= tolerance:
        doubt = (
            f"the multiplier nearest to 1 is {error:.2g} away from it, allowed is {tolerance:g}: the orbit is not "
            "accurate enough; take more harmonics or solve it to a smaller tolerance"
        )
        if np.sort(np.abs(values - 1))[:2].max() < 2 * abs(values[trivial] - 1):
            doubt += " (two are equally near: multipliers that meet at 1, in a conservative system or at a fold, "
            doubt += "err by the square root of the orbit's error)"
    elif not liouville <= tolerance:
        doubt = (
            f"the determinant is off (Liouville): its logarithm is {log_det:.6g}, the integral of the trace "
            f"{trace:.6g}; take more steps"
        )
    verdict, outside, reason = sides(multipliers, trivial, error, doubt)
    reason += f"; error of the trivial multiplier {error:.2g}, of the determinant {liouville:.2g}."
    if motion is not None and k:
        held = ", ".join(expression(row, motion.names) for row in motion.conserved)
        reason += f" Judged among motions with the same conserved values: {held} {'is' if k == 1 else 'are'} "
        reason += f"conserved, which gives {k} multiplier{'s' * (k > 1)} equal to 1."
    others = [i for i in range(len(values)) if i != trivial]
    critical = complex(multipliers[others[0]]) if others else None
    mode = scaled(vectors[:, others[0]]) if others else None
    ones = np.ones(k, dtype=complex)
    values = np.concatenate([values, -ones if parts == 2 else ones])
    order = np.argsort(-np.abs(values), kind="stable")
    halves = values[order] if parts == 2 else None
    return Stability(verdict, values[order] ** parts, error, outside, reason, halves, critical, mode)


def trivial_of(values: Complex, vectors: Complex, rate: Array, size: Array) -> int:
    """Return the place of the trivial multiplier: of those near 1 the one whose vector is the motion's direction.

    Of a cycle that is not resolved another one may be nearer.

    Parameters
    ----------
    values : ndarray, shape (m,)
    vectors : ndarray, shape (n_states, m)
    rate, size : ndarray, shape (n_states,)
        dx/dt where the map begins, and the size of each state.
    """
    distance = np.abs(values - 1)
    near = np.flatnonzero(distance <= CANDIDATES)
    if len(near) < 2 or not np.isfinite(rate).all():
        return int(np.argmin(distance))
    size = np.where(size > 0, size, 1.0)
    along = np.abs((rate / size) @ (vectors[:, near] / size[:, None]))
    along /= np.linalg.norm(vectors[:, near] / size[:, None], axis=0)
    aligned = near[along >= ALIGNED * along.max()]  # where two vectors meet, at a fold, they have the same direction
    return int(aligned[np.argmin(distance[aligned])])


def sides(multipliers: Complex, trivial: int, error: float, doubt: str) -> tuple[str, int, str]:
    """Return the verdict, the number of multipliers outside the unit circle, and the beginning of the reason.

    Parameters
    ----------
    multipliers : ndarray, shape (n_states,)
    trivial : int
        The place of the trivial one.
    error : float
        Error of the multipliers near the unit circle. A multiplier closer to it than `MARGIN` times this error has no
        definite side.
    doubt : str
        Why the verdict is "unknown" whatever the multipliers are; empty if there is no such reason.
    """
    moduli, margin = np.abs(np.delete(multipliers, trivial)), max(MARGIN * error, 1e-8)
    outside, near = int((moduli > 1 + margin).sum()), int((np.abs(moduli - 1) <= margin).sum())
    largest = f"the largest {moduli.max(initial=0.0):.6g}"
    if doubt:
        return "unknown", outside, doubt
    if outside:
        return "unstable", outside, f"{outside} multiplier(s) outside the unit circle, {largest}"
    if near:
        reason = f"{near} multiplier(s) besides the trivial one within {margin:.2g} of the unit circle: "
        reason += f"{NEUTRAL} (a conservative system or a bifurcation)"
        if ones := int((np.abs(np.delete(multipliers, trivial) - 1) <= margin).sum()):
            inside = float(moduli[moduli < 1 - margin].max(initial=0.0))
            reason += f"; {ones} at 1, as where something is conserved and cycles form a family"
            if ones == near:
                reason += f": among cycles of one level the largest is {inside:.6g}" if near < len(moduli) else ""
        return "unknown", 0, reason
    return "stable", 0, f"all multipliers but the trivial one inside the unit circle, {largest}"


def scaled(vector: NDArray[Any]) -> Complex:
    """Return the vector scaled so that its largest entry is 1."""
    return np.asarray(vector / vector[np.argmax(np.abs(vector))], dtype=complex)
