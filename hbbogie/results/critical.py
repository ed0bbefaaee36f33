"""Critical values of a parameter, with their gradients."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hbbogie.brief import LINES, lines
from hbbogie.results.branch import Branch
from hbbogie.results.cycles import searched
from hbbogie.results.orbit import NOT_RESOLVED, Orbit
from hbbogie.results.pictures import page

SHOWN = 5  # largest elasticities shown


@dataclass(frozen=True, eq=False, kw_only=True)
class Critical:
    """A critical value of a parameter.

    Attributes
    ----------
    kind : {"hopf", "fold", "limit"}
    parameter : str
    value : float, unit of the parameter
    extremum : {"minimum", "maximum", ""}
        Of a fold: whether cycles exist above or below the value near by.
    omega : float, rad/s
    gradient : dict of float, unit of the parameter per unit of each
        Derivative of the value with respect to every other parameter.
        Empty where it was not found; the status says why.
    orbit : Orbit
        The cycle at the fold; at a Hopf point the linear cycle along the critical mode.
    residual : float
        Largest scaled residual of the equations that define the point.
    curvature : float
        Of a fold: second derivative of the parameter along the branch in scaled arclength; positive at a minimum.
    status : str
    error : float, unit of the parameter
        Of a fold: bound of the error from harmonics left out, found as the status says; infinite where none was found,
        NaN where none was asked for.
    apart : float
        Of a fold by harmonic balance: distance from 1 of the multiplier that meets the trivial one at a fold, over half
        a period where the cycle is odd; NaN where it was not needed.
    moves : str
        Which groups of bodies move at the point, as `hbbogie.motion.moving_groups` has it: those with at least a tenth
        of the kinetic energy of the group that has most. Empty where coordinates belong to no groups.
    """

    kind: str
    parameter: str
    value: float
    extremum: str
    omega: float
    gradient: dict[str, float]
    orbit: Orbit
    residual: float
    curvature: float
    status: str
    error: float = float("nan")
    apart: float = float("nan")
    moves: str = ""

    def __repr__(self) -> str:
        kind = "Hopf point" if self.kind == "hopf" else self.kind
        at = self.orbit.naming.value(self.parameter, self.value, 9)
        largest = sorted(self.elasticities.items(), key=lambda e: -abs(np.nan_to_num(e[1])))[:SHOWN]
        known = np.isfinite(self.error)
        return lines(
            f"{self.orbit.system}: {kind} at {at}"
            + (f", {self.extremum}" if self.extremum else "")
            + (f" ({self.moves})" if self.moves else ""),
            f"omega {self.omega:.8g} rad/s, residual {self.residual:.1g}" + (f", error {self.error:.1g}" * bool(known)),
            "per cent for one per cent: " + ", ".join(f"{n} {e:+.3g}" for n, e in largest)
            if largest
            else "no gradient",
            self.status,
        )

    def _repr_html_(self) -> str:
        naming, elastic = self.orbit.naming, self.elasticities
        order = sorted(self.gradient, key=lambda n: -abs(np.nan_to_num(elastic[n])))
        rows = [(naming.plain(n), f"{self.gradient[n]:.5g}", f"{elastic[n]:+.4g}") for n in order]
        head = "parameter", f"d{self.parameter} by it", "% for 1 %"
        return page(repr(self), [head, *rows] if rows else ())

    @property
    def resolved(self) -> bool:
        """Whether nothing speaks against the point: of a fold, that the multipliers of its cycle meet at 1."""
        return NOT_RESOLVED not in self.status

    @property
    def elasticities(self) -> dict[str, float]:
        """Relative change of the value per relative change of each parameter [1]: d ln value / d ln p; NaN at 0."""
        p = self.orbit.parameters
        return {n: slope * p[n] / self.value if self.value else float("nan") for n, slope in self.gradient.items()}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LimitPoint(Critical):
    """A value of a parameter at which a cycle meets a limit.

    Attributes
    ----------
    of : str
        Name of the coordinate or output.
    quantity : {"rms", "peak", "first harmonic"}
    limit : float, its unit
    per_limit : float, unit of the parameter per unit of the limit
        Derivative of the value with respect to the limit.
    """

    of: str
    quantity: str
    limit: float
    per_limit: float


class Criticals(list[Critical]):
    """Critical values by growing value: a list with the evidence behind it.

    Parameters
    ----------
    values : iterable of Critical
    evidence : iterable of str
        What was searched: each branch, how far it was followed and why it ended, sentences.
    undecided : iterable of str
        What was not searched to its end, so that a critical value may be missing, sentences; empty where nothing was.
    branches : iterable of Branch
        Those that were followed by harmonic balance, as coarsely as the search needed, and those in closed form where
        coordinates belong to groups.
    """

    def __init__(
        self,
        values: Iterable[Critical] = (),
        evidence: Iterable[str] = (),
        undecided: Iterable[str] = (),
        branches: Iterable[Branch] = (),
    ):
        super().__init__(values)
        self.evidence, self.undecided, self.branches = tuple(evidence), tuple(undecided), tuple(branches)

    @property
    def lowest(self) -> dict[str, Critical]:
        """The lowest fold from which cycles exist upwards, of each set of groups that move, the lowest of all first.

        Without groups there is one, named "". Empty where there is no such fold.
        """
        found: dict[str, Critical] = {}
        for c in sorted(self, key=lambda c: c.value):
            if c.kind == "fold" and c.extremum == "minimum":
                found.setdefault(c.moves, c)
        return found

    @property
    def complete(self) -> bool:
        """Whether every branch was followed to its end."""
        return not self.undecided

    def __repr__(self) -> str:
        moves = [f" ({c.moves})" * bool(c.moves) for c in self]
        found = [
            f"{c.kind} at {c.parameter} = {c.value:.9g}{who}, omega = {c.omega:.6g}: {c.status}"
            for c, who in zip(self, moves, strict=True)
        ]
        counted = f"{len(self) or 'no'} critical value{'s' * (len(self) != 1)}"
        of = f" of {self[0].orbit.system}" if self else ""
        told = searched(self.evidence, self.undecided)
        return lines(counted + of, *(found or self.evidence)[: LINES - 1 - len(told)], *told)
