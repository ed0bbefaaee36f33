"""All equilibria over an interval, and their Hopf points, with what was searched."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from hbbogie.brief import lines
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.pictures import page

ONE_VALUE = 1e-10  # share of the interval up to which two values are one


@dataclass(frozen=True, eq=False)
class Equilibria:
    """The branches of equilibria over an interval of a parameter; behaves like a tuple of them.

    Attributes
    ----------
    branches : tuple of Branch
        Each of orbits with H = 0, with folds, branch points and Hopf points as special points.
    parameter : str
    interval : (float, float), unit of the parameter
    evidence : tuple of str
        What was searched, what is held, why each branch ended and what was not located, sentences.
    """

    branches: tuple[Branch, ...]
    parameter: str
    interval: tuple[float, float]
    evidence: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.branches)

    def __iter__(self) -> Iterator[Branch]:
        return iter(self.branches)

    def __getitem__(self, i: int) -> Branch:
        return self.branches[i]

    def special(self, kind: str) -> list[SpecialPoint]:
        """Return the special points of a kind on all branches, by growing parameter."""
        return in_order((s for b in self.branches for s in b.special if s.kind == kind), self.interval)

    def __repr__(self) -> str:
        low, high = self.interval
        head = f"{len(self)} branch{'es' * (len(self) != 1)} of equilibria, {self.parameter} from {low:g} to {high:g}"
        points = [s.headline for b in self.branches for s in b.special]
        return lines(head, "; ".join(points), *self.evidence)

    def _repr_html_(self) -> str:
        return page(repr(self))


def in_order(points: Iterable[SpecialPoint], interval: tuple[float, float]) -> list[SpecialPoint]:
    """Return special points by growing parameter, those at one value by growing frequency."""
    same = ONE_VALUE * (interval[1] - interval[0])
    return sorted(points, key=lambda s: (round(s.value / same), s.orbit.omega))


class HopfPoints(list[SpecialPoint]):
    """Hopf points by growing parameter: a list with the evidence behind it.

    Parameters
    ----------
    points : iterable of SpecialPoint
    evidence : tuple of str
        What was searched and what was not located, sentences.
    undecided : tuple of str
        What was not located, and what was not searched to its end, so that a Hopf point may be missing.
    """

    def __init__(
        self,
        points: Iterable[SpecialPoint] = (),
        evidence: tuple[str, ...] = (),
        undecided: tuple[str, ...] = (),
    ):
        super().__init__(points)
        self.evidence, self.undecided = evidence, undecided

    def __repr__(self) -> str:
        points = [f"{s.parameter} = {s.value:.9g}, omega = {s.omega:.6g}: {s.status}" for s in self]
        return lines(f"{len(self)} Hopf point{'s' * (len(self) != 1)}", *points, *self.evidence)

    def _repr_html_(self) -> str:
        return page(repr(self))
