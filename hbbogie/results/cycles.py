"""The cycles at a value of the parameters, with what was searched."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import shorten

from hbbogie.brief import LINES, WIDTH, columns
from hbbogie.results.orbit import Orbit
from hbbogie.results.pictures import page


class Cycles(list[Orbit]):
    """Cycles by growing amplitude: a list with the evidence behind it, which prints as a table.

    Parameters
    ----------
    orbits : iterable of Orbit
    evidence : sequence of str
        What was searched and found, what became of it, and what stayed undecided, sentences.
    undecided : sequence of str
        What was cut short, by a limit of time or because a branch could not be followed to its end, so that a cycle may
        be missing, sentences; empty where nothing was.
    """

    def __init__(self, orbits: Iterable[Orbit] = (), evidence: Iterable[str] = (), undecided: Iterable[str] = ()):
        super().__init__(orbits)
        self.evidence, self.undecided = tuple(evidence), tuple(undecided)

    @property
    def complete(self) -> bool:
        """Whether nothing cut the search short."""
        return not self.undecided

    def rows(self) -> list[list[str]]:
        """Return the cycles as a table of text: the head, then period, frequency, peaks, verdict and error of each."""
        names = list(self[0].coordinates[:COORDINATES]) if self else []
        table = [["", "period [s]", "omega [rad/s]", *(f"peak {n}" for n in names), "stability", "multiplier", "error"]]
        for i, o in enumerate(self):
            largest, peaks = o.largest_multiplier, o.peaks()
            error = f"{o.errors['waveform']:.0e}" if o.errors else ""
            shown = ["" if largest is None else f"{largest:.5g}", error]
            judged = o.stability.verdict if o.stability else "not judged"
            sizes = [peaks.get(n, "") for n in names]
            table.append([str(i), f"{o.period:.7g}", f"{o.omega:.7g}", *sizes, judged, *shown])
        return table

    def __repr__(self) -> str:
        counted = f"{len(self)} cycle{'s' * (len(self) != 1)}"
        of = f" of {self[0].system} at {self[0].naming.values(self[0].parameters)}" if self else ""
        shown = columns(self.rows()[: LINES - 1]) if self else list(self.evidence[:SHOWN])
        more = [f"... {len(self) - LINES + 2} more"] if len(self) > LINES - 2 else []
        said = searched(self.evidence, self.undecided)
        return "\n  ".join([(counted + of).removesuffix(" at "), *shown, *more, *said])

    def _repr_html_(self) -> str:
        return page(repr(self).partition("\n")[0], self.rows()[: 1 + DRAWN], "orbit" if self else "", self[:DRAWN])


def searched(evidence: Sequence[str], undecided: Sequence[str]) -> list[str]:
    """Return in two lines at most where a search is told, and what cut it short."""
    said = [f"searched: {len(evidence)} sentences in .evidence"] if evidence else []
    return said + [shorten(f"not complete: {undecided[0]}", 2 * WIDTH, placeholder=" ...") for _ in undecided[:1]]


SHOWN = 3  # sentences where there is no cycle
DRAWN = 8  # cycles drawn in a thumbnail
COORDINATES = 2  # whose peaks are shown
