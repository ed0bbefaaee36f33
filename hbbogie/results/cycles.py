"""The cycles at a value of the parameters, with what was searched."""

from __future__ import annotations

from collections.abc import Iterable

from hbbogie.results.orbit import Orbit


class Cycles(list[Orbit]):
    """Cycles by growing amplitude: a list with the evidence behind it.

    Parameters
    ----------
    orbits : iterable of Orbit
    evidence : sequence of str
        What was searched and found, what became of it, and what stayed undecided, sentences.
    """

    def __init__(self, orbits: Iterable[Orbit] = (), evidence: Iterable[str] = ()):
        super().__init__(orbits)
        self.evidence = tuple(evidence)

    def __repr__(self) -> str:
        found = [f"period {o.period:.6g} s, {o.stability.verdict if o.stability else 'not judged'}" for o in self]
        counted = f"{len(self.evidence)} sentences on what was searched in .evidence"
        shown = [] if self else [*self.evidence[:SHOWN]]
        return "\n  ".join([f"{len(self)} cycle(s)", *found, *shown, counted])


SHOWN = 3
