"""The same cycles by several methods, side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from hbbogie.brief import brief, lines
from hbbogie.results import Branch, Orbit
from hbbogie.units import behind


@dataclass(frozen=True, eq=False)
class TracedBranch:
    """A branch by one method.

    Attributes
    ----------
    name : str
        Such as "df1" or "mhb15".
    branch : Branch
    building, tracing : float, s
        Time taken to build the equations and to trace the branch.
    cycles : callable
        Yields the cycles at a parameter value, each with its part of the branch.
    """

    name: str
    branch: Branch
    building: float
    tracing: float
    cycles: Callable[[float], Iterator[tuple[int, Orbit]]]

    __repr__ = brief

    @property
    def fold(self) -> float | None:
        """Smallest parameter value at a fold: where cycles of large amplitude begin; None without a fold."""
        return min((s.value for s in self.branch.folds()), default=None)

    def at(self, value: float) -> dict[int, tuple[Orbit, float]]:
        """Return the cycles at a parameter value and the time of each [s], by the part of the branch.

        Part k lies behind k folds, counted from the Hopf point.
        """
        found: dict[int, tuple[Orbit, float]] = {}
        start = time.perf_counter()
        for part, orbit in self.cycles(value):
            if part not in found:
                found[part] = orbit, time.perf_counter() - start
            start = time.perf_counter()
        return found


@dataclass(frozen=True, eq=False)
class Compared:
    """One cycle by all methods.

    Attributes
    ----------
    value : float, unit of the parameter
    part : int
        Part of the branch, counted in folds from the Hopf point.
    truth : Orbit
    orbits : dict of Orbit or None
        By method; None where the method has no such cycle.
    seconds : dict of float, s
        Time of the solve at this value, by method.
    """

    value: float
    part: int
    truth: Orbit
    orbits: dict[str, Orbit | None]
    seconds: dict[str, float]

    __repr__ = brief

    def error(self, method: str, quantity: Callable[[Orbit], float]) -> float | None:
        """Return the relative error of a quantity [%]; None where the method has no cycle."""
        orbit = self.orbits[method]
        return None if orbit is None else 100 * (quantity(orbit) / quantity(self.truth) - 1)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Cycles over a parameter by several methods.

    Attributes
    ----------
    parameter, unit : str
    coordinates : tuple of str
        The coordinates whose amplitudes are compared: those on which elements act, such as the lateral displacements of
        wheelsets at their flanges; where there are none, all that enter nonlinearly.
    methods : dict of TracedBranch
        By name; the converged one is among them.
    truth : str
        Name of the method taken as the truth.
    rows : tuple of Compared
    left_out : tuple of str
        A sentence on each method that would be compared by default and cannot do the system.
    """

    parameter: str
    unit: str
    coordinates: tuple[str, ...]
    methods: dict[str, TracedBranch]
    truth: str
    rows: tuple[Compared, ...]
    left_out: tuple[str, ...] = ()

    def __repr__(self) -> str:
        values = [row.value for row in self.rows]
        at = f" at {self.parameter} = {min(values):g} to {max(values):g}{behind(self.unit)}" if values else ""
        return lines(
            f"{len(self.rows)} cycles{at} beside {self.truth}", *map(self._said, self.approximations), *self.left_out
        )

    def _said(self, method: str) -> str:
        """Return the largest errors of a method in words."""
        said = []
        for what, quantity in self.quantities().items():
            errors = [abs(e) for row in self.rows if (e := row.error(method, quantity)) is not None]
            said += [f"{what} {max(errors):.2g} %"] if errors and not what.startswith("first") else []
        lost = sum(row.orbits[method] is None for row in self.rows)
        return f"{method}: largest errors {', '.join(said) or 'unknown'}" + f"; {lost} cycles not found" * bool(lost)

    @property
    def approximations(self) -> tuple[str, ...]:
        """Names of the methods that are compared with the truth."""
        return tuple(name for name in self.methods if name != self.truth)

    def quantities(self) -> dict[str, Callable[[Orbit], float]]:
        """Return what is compared: frequency, and peak and first harmonic of each coordinate, by header."""
        chosen: dict[str, Callable[[Orbit], float]] = {"omega": lambda o: o.omega}
        for c in self.coordinates:
            chosen[f"peak {c}"] = lambda o, c=c: o.amplitude(c)  # type: ignore[misc]
            chosen[f"first harmonic {c}"] = lambda o, c=c: o.first_harmonic(c)  # type: ignore[misc]
        return chosen
