"""The unknowns of harmonic balance: which coefficients of which coordinates, in which order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import ModelError
from hbbogie.methods.condensation import kept_coordinates
from hbbogie.model.parts import Parts
from hbbogie.model.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Layout:
    """The unknowns z: coefficients of the coordinates S (column by column), means of all n, omega.

    Attributes
    ----------
    n : int
        Number of coordinates.
    kept : tuple of int
        Harmonics kept.
    H : int
        Highest harmonic.
    S : tuple of int
        Coordinates that are not condensed out.
    phase : int or None
        Coordinate whose sine coefficient of harmonic 1 is zero and not an unknown; None for equilibria.
    samples : int
        Samples per period of the sampled forces.
    half : bool
        Whether half a period represents the whole: for odd harmonics, if the system is odd for all parameter values.
    parts : Parts
        The system divided into its parts.
    advance : tuple of float
        By how much each coordinate grows in a period; empty where none runs on. Then the mean of the first that does
        is zero and not an unknown, which sets the phase.
    """

    n: int
    kept: tuple[int, ...]
    H: int
    S: tuple[int, ...]
    phase: int | None
    samples: int
    half: bool
    parts: Parts
    advance: tuple[float, ...] = ()

    @property
    def odd(self) -> bool:
        """Whether only odd harmonics are kept."""
        return self.kept[0] != 0

    @property
    def moving(self) -> tuple[int, ...]:
        """The harmonics above 0."""
        return tuple(h for h in self.kept if h)

    @property
    def waves(self) -> int:
        """Number of cosine and sine coefficients of a coordinate."""
        return 2 * len(self.moving)

    @property
    def means(self) -> tuple[int, ...]:
        """The coordinates whose means are unknowns: none, or all but one that sets the phase where it runs on."""
        return () if self.odd else tuple(i for i in range(self.n) if not self.advance or i != self.phase)

    @property
    def drift(self) -> Array:
        """Growth of each coordinate per radian of the phase, shape (n,) (eq-running)."""
        return np.array(self.advance or np.zeros(self.n)) / (2 * np.pi)

    @cached_property
    def keep(self) -> NDArray[np.int_]:
        """Places of the coefficients above harmonic 0 that are unknowns (all except the one that sets the phase)."""
        keep = np.ones(self.waves * len(self.S), dtype=bool)
        if self.phase is not None and not self.advance:
            keep[self.S.index(self.phase) * self.waves + 1] = False
        return np.flatnonzero(keep)

    @cached_property
    def cosines(self) -> dict[int, int]:
        """Place in z of the cosine coefficient of harmonic 1, by coordinate."""
        first = {i: k * self.waves for k, i in enumerate(self.S if 1 in self.kept else ())}
        return {i: int(np.searchsorted(self.keep, place)) for i, place in first.items()}

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.keep) + len(self.means) + bool(self.moving)

    def unpack(self, z: Any) -> tuple[Any, Any, Any]:
        """Return the coefficients, shape (waves, len(S)), the means, shape (n,), and omega as expressions."""
        kind = type(z)
        if not self.moving:
            return kind(0, len(self.S)), z, kind(0)
        X = ca.reshape(ca.mtimes(self._insertion, z[: len(self.keep)]), self.waves, len(self.S))
        return X, self._means(z, kind), z[-1]

    def _means(self, z: Any, kind: Any) -> Any:
        if len(self.means) == self.n:
            return z[len(self.keep) : -1]
        mean = kind.zeros(self.n)
        if self.means:
            mean[list(self.means)] = z[len(self.keep) : -1]
        return mean

    @cached_property
    def _insertion(self) -> ca.DM:
        rows, columns = list(map(int, self.keep)), list(range(len(self.keep)))
        return ca.DM(ca.Sparsity.triplet(self.waves * len(self.S), len(columns), rows, columns), 1.0)

    def from_coefficients(self, c: Array, omega: float) -> Array:
        """Return the unknowns z of the coefficients c, shape (2 H' + 1, n), and omega."""
        c = fourier.resize(c, self.H)
        if not self.moving:
            return np.array(c[0])
        moving = c[np.ix_(fourier.rows_of(self.moving), np.array(self.S))].ravel(order="F")[self.keep]
        return np.concatenate([moving, c[0, list(self.means)], [omega]])


def make_layout(
    system: System,
    parts: Parts,
    kept: tuple[int, ...],
    *,
    H: int,
    samples: int,
    condense: bool,
    phase: str | None,
    advance: tuple[float, ...] = (),
) -> Layout:
    """Return which coefficients of which coordinates are unknowns.

    Parameters
    ----------
    system : System
    parts : Parts
        The system divided into its parts.
    kept : tuple of int
        Harmonics kept.
    H : int
        Highest harmonic of the orbits.
    samples : int
        Samples per period of the sampled forces.
    condense : bool
        Whether coordinates that enter linearly are eliminated.
    phase : str or None
        Coordinate that sets the phase; None for the first that enters nonlinearly.
    advance : tuple of float
        By how much each coordinate grows in a period.

    Raises
    ------
    ModelError
        When the coordinate that is to set the phase is condensed out.
    """
    nonlinear = parts.nonlinear or tuple(range(system.n))
    S = kept_coordinates(parts, nonlinear) if condense else tuple(range(system.n))
    place = next((i for i, by in enumerate(advance) if by), None)
    if any(kept) and place is None:
        place = nonlinear[0] if phase is None else system.index(phase)
        if place not in S:
            raise ModelError(
                f"phase={phase!r} enters linearly and is condensed out; choose among "
                f"{', '.join(system.coordinate_names[i] for i in S)}, or set condense=False."
            )
    return Layout(system.n, kept, H, S, place, samples, kept[0] != 0 and system.odd, parts, advance)
