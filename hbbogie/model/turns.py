"""Coordinates that may run on: whole turns that change no equation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError

if TYPE_CHECKING:
    from hbbogie.model.dynamics import Dynamics

Array = NDArray[np.float64]
TRIALS = 20
ZERO = 1e-11  # largest change of an equation, relative to its size, that is round-off


def turns_of(system: Dynamics) -> Array:
    """Return the turn of each coordinate, shape (n,) [its unit]; 0 of those that cannot run on."""
    return np.array([c.turn or 0.0 for c in system.coordinates])


def changed(system: Dynamics, advance: ArrayLike) -> list[int]:
    """Return the equations that change when the coordinates advance, found at random states.

    Parameters
    ----------
    system : Dynamics
    advance : array_like, shape (n,), unit of the coordinate
    """
    rng, n = np.random.default_rng(2), system.n
    by = np.asarray(advance, dtype=float)
    size = np.where(by != 0, np.abs(by), 1.0)[:, None]
    q, v, a = (size * rng.standard_normal((n, TRIALS)) for _ in range(3))
    # terms that are absent by default count too
    ones = np.array([np.clip(1.0, *p.bounds) for p in system.parameters])
    p = np.tile(np.where(system.defaults == 0, ones, system.defaults)[:, None], TRIALS)
    residual = system.once(("residual", TRIALS), lambda: system.residual.map(TRIALS))
    before, after = (np.array(residual(x, v, a, p)) for x in (q, q + by[:, None]))
    with np.errstate(invalid="ignore"):
        scale = np.fmax(np.abs(before), 1.0).max(axis=1, keepdims=True)
        return [int(i) for i in np.flatnonzero((np.abs(after - before) > ZERO * scale).any(axis=1))]


def check_turns(system: Dynamics) -> None:
    """Raise `ModelError` where a turn of all coordinates that have one changes the equations."""
    turns = turns_of(system)
    if turns.any() and (bad := changed(system, turns)):
        which = ", ".join(f"{c.name} by {c.turn:.6g}" for c in system.coordinates if c.turn)
        raise ModelError(
            f"system {system.name!r}: a turn ({which}) changes equation {bad[0] + 1}; an angle may enter by functions "
            "of this period only, such as sin(phi), or by differences of angles that turn together. Leave turn= out "
            "for coordinates that do not run on."
        )


def check_advance(system: Dynamics, advance: tuple[float, ...]) -> None:
    """Raise `ModelError` unless an orbit's advance is whole turns that change no equation."""
    turns = turns_of(system)
    for c, by in zip(system.coordinates, advance, strict=True):
        if by and (not c.turn or abs(by / c.turn - round(by / c.turn)) > 1e-9):
            declared = f"its turn is {c.turn:.6g}" if c.turn else f'declare it with Coordinate("{c.name}", turn=...)'
            raise ModelError(
                f"system {system.name!r}: the orbit advances {c.name} by {by:.6g} in a period, and allowed are whole "
                f"turns: {declared}."
            )
    if any(advance) and changed(system, advance):
        raise ModelError(
            f"system {system.name!r}: equations change when the coordinates advance by {advance}, so that no solution "
            f"runs on like this; the turns are {tuple(turns.tolist())}, and angles that are coupled turn together."
        )
