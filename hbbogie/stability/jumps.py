"""Passages through surfaces at which the vector field jumps: their jump matrices, and motions that stick there.

The jump (saltation) matrix goes back to M. A. Aizerman and F. R. Gantmakher, On the stability of periodic
motions, J. Appl. Math. Mech. 22 (1958) 1065-1078 (theory page, eq-jump).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.model.elements import AttachedLaw
from hbbogie.model.system import System
from hbbogie.stability.elements import field_of
from hbbogie.stability.paths import Path
from hbbogie.stability.shooting import Shooting
from hbbogie.stability.variation import Waveforms, contacts_of

Array = NDArray[np.float64]

# rad; distance before and after a phase at which the lines of the contacts are compared; also the share of the cycle
# within which two jumps count as simultaneous
EITHER_SIDE = 1e-9
MARGIN = 1e-6  # smallest normal speed, relative to that on the other side, at which a motion counts as passing
PARALLEL = 1e-9  # two normals count as one when the sine of their angle is smaller


@dataclass(frozen=True, eq=False)
class Passages:
    """The K passages of a cycle through surfaces at which the vector field jumps, in the order of time.

    Attributes
    ----------
    place : ndarray of int, shape (K,)
        The interval or element of the cycle that begins with the passage.
    matrices : ndarray, shape (K, n_states, n_states)
        The effect of each passage on a disturbance (eq-jump).
    before, after : ndarray, shape (K,), unit of the contact's argument per s
        Speed of the argument on either side.
    sticking, corner : str
        Clauses that say where the motion does not pass, and where two surfaces meet so that no matrix describes the
        passage of disturbances. Empty if this does not happen.
    """

    place: NDArray[np.int_]
    matrices: Array
    before: Array
    after: Array
    sticking: str = ""
    corner: str = ""

    @property
    def obstacle(self) -> str:
        """Clause that says why the matrices do not describe the disturbances; empty if they do."""
        return self.sticking or self.corner

    def inserted(self, transitions: Array) -> Array:
        """Return the transition matrices of intervals or elements, including those of the passages."""
        out = transitions.copy() if len(self.place) else transitions
        for i, S in zip(self.place[::-1], self.matrices[::-1], strict=True):
            out[i] = out[i] @ S
        return out

    @property
    def log_determinant(self) -> float:
        """Sum of the logarithms of the determinants."""
        return float(np.log(np.abs(self.after / self.before)).sum())


def passages_along(waveforms: Waveforms, mesh: Array, of: int = 0) -> Passages:
    """Return the passages of one of some orbits, whose switchings are on the mesh.

    Parameters
    ----------
    waveforms : Waveforms
    mesh : ndarray, shape (N + 1,), rad
    of : int
        The place of the orbit.
    """
    system, phases = waveforms.system, mesh[:-1]
    jumping = [i for i, e in enumerate(contacts_of(system)) if e.heights is not None]
    if not jumping:
        return _none(system)
    before, after = (waveforms.lines(phases + side, of) for side in (-EITHER_SIDE, EITHER_SIDE))
    nodes = np.flatnonzero((before != after).any(axis=1))
    # a jump between two close nodes of the mesh is seen at both, but counts once
    next_one = np.append(phases[nodes[1:]], phases[nodes[:1]] + mesh[-1])
    place: list[int] = []
    contact: list[int] = []
    lines: list[tuple[Array, Array]] = []
    for k in nodes[next_one - phases[nodes] > EITHER_SIDE]:
        now = before[k].copy()
        for i in jumping:
            pair = slice(2 * i, 2 * i + 2)
            if (before[k, pair] != after[k, pair]).any():
                then = now.copy()
                then[pair] = after[k, pair]
                place.append(int(k))
                contact.append(i)
                lines.append((now, then))
                now = then
    if not place:
        return _none(system)
    x = waveforms.all_states.at(phases[place], of=of)
    sides = np.array(lines)
    when = phases[place] / mesh[-1]
    return _passages(system, waveforms.p[of], np.array(place), when, np.array(contact), x, sides[:, 0], sides[:, 1])


def passages_of(shooting: Shooting, path: Path) -> Passages:
    """Return the passages of a motion by shooting; matrices for its scaled states."""
    system, pattern = shooting.system, shooting.pattern
    contacts = contacts_of(system)
    k = np.array([s for s, i in enumerate(pattern.contact) if contacts[i].heights is not None], dtype=int)
    if not len(k):
        return _none(system)
    ends = np.cumsum(path.durations)
    place, when = np.searchsorted(path.segment, k), (ends - path.durations)[k] / ends[-1]
    x, lines = path.x[place] * shooting.scale, pattern.lines
    return _passages(system, shooting.p, place, when, pattern.contact[k], x, lines[k - 1], lines[k], shooting.scale)


def _none(system: System) -> Passages:
    n = system.n_states
    return Passages(np.empty(0, dtype=int), np.empty((0, n, n)), np.empty(0), np.empty(0))


def _passages(
    system: System,
    p: Array,
    place: NDArray[np.int_],
    when: Array,
    contact: NDArray[np.int_],
    x: Array,
    lines_before: Array,
    lines_after: Array,
    scale: Array | float = 1.0,
) -> Passages:
    """Return the passages at states x, shape (K, n_states), with the lines of all contacts on either side.

    ``when``, shape (K,), are their times as shares of the whole motion.
    """
    field, arguments, _ = field_of(system)
    K = len(place)
    f, g = (field(x.T, lines.T, p)[0].full().T / scale for lines in (lines_before, lines_after))
    normal = arguments(x.T, lines_before.T, p)[1].full().reshape(-1, K, x.shape[1])[contact, np.arange(K)] * scale
    before, after = (np.einsum("ki,ki->k", normal, rates) for rates in (f, g))
    passing = np.where(before != 0, before, np.nan)
    matrices = np.eye(x.shape[1]) + (g - f)[:, :, None] * (normal / passing[:, None])[:, None, :]
    elements = [contacts_of(system)[i] for i in contact]
    sticking, corner = _sticking(elements, before, after), _corner(elements, when, normal)
    return Passages(place, matrices, before, after, sticking, corner)


def _sticking(contacts: list[AttachedLaw], before: Array, after: Array) -> str:
    """Return a clause that says where the field does not lead through a surface on both sides, or an empty text."""
    slow, fast = np.minimum(np.abs(before), np.abs(after)), np.maximum(np.abs(before), np.abs(after))
    stuck = np.flatnonzero(~((before * after > 0) & (slow > MARGIN * fast)))
    if not len(stuck):
        return ""
    k = stuck[0]
    return (
        f"the motion does not pass where element {contacts[k].name!r} jumps (the rate of its argument is "
        f"{before[k]:.3g} before and {after[k]:.3g} after): it sticks, or slides along the surface, which is not "
        "followed; take a regularised law, such as Friction"
    )


def _corner(contacts: list[AttachedLaw], when: Array, normal: Array) -> str:
    """Return a clause that says where two elements with different arguments jump at the same time, or an empty text."""
    unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    for k in np.flatnonzero(np.append(when[1:], when[0] + 1) - when <= EITHER_SIDE):
        after = (k + 1) % len(when)
        a, b = unit[k], unit[after]
        if np.linalg.norm(b - (a @ b) * a) > PARALLEL:
            return (
                f"elements {contacts[k].name!r} and {contacts[after].name!r} jump at the same time, and small "
                "disturbances that let either come first can have different consequences"
            )
    return ""
