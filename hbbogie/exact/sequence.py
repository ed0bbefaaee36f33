"""The order in which a cycle crosses surfaces, and operations that change it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.model import SwitchedLinear

Sides = tuple[bool, ...]


@dataclass(frozen=True)
class Sequence:
    """S phases of a cycle, or of half of one, each in one contact state and ended by crossing a surface.

    Attributes
    ----------
    sides : tuple of S tuples of K bool
        On which side of each surface the motion is.
    events : tuple of S int
        The surface that is crossed at the end of each phase.
    sigma : {1, -1}
        The state at the end is sigma times that at the start: -1 over half a period of an odd cycle.
    """

    sides: tuple[Sides, ...]
    events: tuple[int, ...]
    sigma: int

    @property
    def S(self) -> int:
        """Number of phases."""
        return len(self.events)

    @cached_property
    def states(self) -> NDArray[np.float64]:
        """The U different contact states, as numbers 0 and 1, shape (U, K)."""
        return np.array(list(dict.fromkeys(self.sides)), dtype=float)

    @cached_property
    def of(self) -> NDArray[np.int_]:
        """The place of each phase's contact state among `states`, shape (S,)."""
        place = {sides: k for k, sides in enumerate(dict.fromkeys(self.sides))}
        return np.array([place[s] for s in self.sides])

    @cached_property
    def touching(self) -> tuple[int, ...]:
        """Phases, except the first, that begin and end on the same surface: contacts that may vanish in a grazing."""
        return tuple(i for i in range(1, self.S) if self.events[i] == self.events[i - 1])

    def without(self, i: int) -> Sequence:
        """Return the sequence without the contact in phase i, whose neighbours become one phase (0 < i < S - 1)."""
        events = self.events[: i - 1] + self.events[i + 1 :]
        return replace(self, sides=self.sides[:i] + self.sides[i + 2 :], events=events)

    def swapped(self, i: int) -> Sequence:
        """Return the sequence with the events at the two ends of phase i exchanged (0 < i < S - 1)."""
        a, b = self.events[i - 1], self.events[i]
        between = crossed(self.sides[i - 1], b)
        return replace(
            self,
            sides=(*self.sides[:i], between, *self.sides[i + 1 :]),
            events=(*self.events[: i - 1], b, a, *self.events[i + 1 :]),
        )

    def touched(self, i: int, k: int) -> Sequence:
        """Return the sequence in which surface k is crossed and crossed back within phase i."""
        here = self.sides[i]
        return replace(
            self,
            sides=(*self.sides[: i + 1], crossed(here, k), *self.sides[i:]),
            events=(*self.events[:i], k, k, *self.events[i:]),
        )

    def rotated(self, i: int, model: SwitchedLinear) -> Sequence:
        """Return the same cycle, beginning with phase i."""
        sides, events = self.sides[:i], self.events[:i]
        if self.sigma < 0:
            assert model.mirror is not None
            sides, events = tuple(map(model.mirrored, sides)), tuple(int(model.mirror[e]) for e in events)
        return replace(self, sides=self.sides[i:] + sides, events=self.events[i:] + events)

    def closes(self, model: SwitchedLinear) -> bool:
        """Return whether the contact state at the end is that at the start, mirrored for half a period."""
        end = crossed(self.sides[-1], self.events[-1])
        return self.sides[0] == (model.mirrored(end) if self.sigma < 0 else end)


def crossed(sides: Sides, k: int) -> Sides:
    """Return the contact state beyond surface k."""
    return (*sides[:k], not sides[k], *sides[k + 1 :])
