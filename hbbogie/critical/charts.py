"""Charts: curves of folds and of Hopf points in the plane of two parameters, without a guess."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.choice import chosen_methods
from hbbogie.critical.first_folds import Fold, FoldSearch, curve_of, folds_of, with_curve
from hbbogie.critical.following import Followed, Test, both_ways, follow, not_covered, passes, plane
from hbbogie.critical.hopf_curve import HopfCurve
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door, whole
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.parallel import each, in_processes, processes_asked
from hbbogie.progress import Progress, part, silent
from hbbogie.results import Chart, ChartPoint, CriticalCurve, SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import FAILURES
from hbbogie.solving.curve import Point
from hbbogie.units import behind, label

Array = NDArray[np.float64]
SEARCHED = 4  # values of the second parameter, evenly over the interval, at which curves are looked for
HOPF, BRANCHES = 0.05, 0.3  # shares of the work that are done with the Hopf points, and with the first folds
ROUND_OFF = 1e-14  # of the chart's width and height
UNDECIDED = 1e-12  # Lyapunov coefficient that counts as zero
FOLLOWS = ("exact", "mhb")  # methods by which curves of folds are followed
HARMONICS = 15  # where none are given


@door(system=System, parameter=str, over=str)
def chart(
    system: System,
    parameter: str,
    over: str,
    interval: tuple[float, float] | None = None,
    *,
    span: tuple[float, float] | None = None,
    method: str = "auto",
    harmonics: int | None = None,
    secondary: bool = False,
    longest: float = 0.1,
    workers: int = 1,
    progress: Progress = silent,
    **values: float,
) -> Chart:
    """Follow the critical values of a parameter over a second one: curves of folds and of Hopf points.

    Needs no guess: curves are looked for at the system's value of the second parameter and at some more over the
    interval, and followed by predictor and corrector. What cannot be computed is a note.

    Parameters
    ----------
    system : System
    parameter, over : str
        The parameter whose critical values are followed, and the one over which.
    interval : (float, float), optional, unit of the second parameter
        Twice the parameter's value (at least 1) to either side, within its bounds, where left out.
    span : (float, float), optional, unit of the first parameter
        Where critical values are looked for; likewise.
    method : {"auto", "exact", "mhb"}
        By which folds are found and followed: "exact" in closed form, for systems that are linear between switchings;
        "mhb" by multi-harmonic balance. "auto" is "exact" where that applies, and "mhb" for the branches that it does
        not follow to their ends.
    harmonics : int, optional
        Highest harmonic of the cycles by harmonic balance, 15 where none is given; where it is given, "auto" is "mhb".
    secondary : bool
        Whether to look for folds also on the branches from Hopf points beside which the equilibrium is unstable on
        both sides.
    longest : float
        Longest step along a curve; a quarter of the chart's width and height is one unit.
    workers : int
        Processes among which branches and curves are shared; a script that asks for several does so below
        ``if __name__ == "__main__":``.
    progress : callable
        Called with (message, fraction done or None).
    **values : float
        Parameter values, by name.

    Returns
    -------
    Chart

    Raises
    ------
    ModelError
        For wrong names or values, or an empty interval.

    References
    ----------
    Theory page, eq-fold-curve, eq-hopf-curve, eq-lyapunov and eq-grazing-onset.
    """
    system = system.with_parameters(**values)
    if parameter == over:
        raise ModelError(f"chart: both parameters are {parameter!r}; give two different ones.")
    methods = [name for name in chosen_methods("chart", system, method, harmonics) if name in FOLLOWS]
    if not methods:
        raise ModelError(
            f'chart: method={method!r} follows no curve over two parameters; take method="mhb" with more harmonics, or '
            "critical_speeds, for many designs critical_speeds_of, at values of the second parameter."
        )
    harmonics = HARMONICS if harmonics is None else harmonics
    whole("chart: harmonics", harmonics)
    if not longest > 0:
        raise ModelError(f"chart: longest={longest!r}; give a positive step.")
    window = check_interval(system, parameter, span), check_interval(system, over, interval)
    HarmonicBalance(harmonics).check(system)
    search = _Search(FoldSearch(system, (parameter, over), *window, harmonics, methods, longest))
    for name, asked, kept in zip((parameter, over), (span, interval), window, strict=True):
        if asked is not None and tuple(map(float, asked)) != kept:
            search.notes.append(
                f"The range of {name}, ({asked[0]:g}, {asked[1]:g}), was cut to its bounds: ({kept[0]:g}, {kept[1]:g})."
            )
    with in_processes(workers):
        for k, value in enumerate(search.places):
            progress(f"Hopf points: {over} = {value:g}", HOPF * k / len(search.places))
            search.hopf_at(value)
        search.look_for_folds(secondary, progress)
    return search.chart(secondary)


class _Search:
    """The curves found so far, and the search for more."""

    def __init__(self, search: FoldSearch):
        self.search, self.system, self.names = search, search.system, search.names
        self.span, self.interval = search.span, search.interval
        own = self.system.values[self.names[1]]
        places = {
            *np.linspace(*self.interval, SEARCHED),
            *([own] if self.interval[0] <= own <= self.interval[1] else []),
        }
        self.places = sorted(map(float, places), key=lambda value: (value != own, value))
        self.starts: dict[float, list[tuple[SpecialPoint, bool]]] = {}
        self.hopf: list[Followed] = []
        self.folds: list[Followed] = []
        self.doubts: list[str] = []
        self.notes: list[str] = []

    @contextmanager
    def _noted(self, what: str) -> Iterator[None]:
        """Make a failure a note."""
        try:
            yield
        except FAILURES as error:
            self.notes.append(f"{what}: {error}")

    def hopf_at(self, value: float) -> None:
        """Find the Hopf points at a value of the second parameter, and follow those on no curve found before."""
        (name, over) = self.names
        system = self.system.with_parameters(**{over: value})
        self.starts[value] = []
        points: list[SpecialPoint] = []
        with self._noted(f"Hopf points at {over} = {value:g}"):
            points = hopf_points(system, name, self.span)
        for hopf in points:
            with self._noted(f"The curve through the Hopf point at {name} = {hopf.value:g}, {over} = {value:g}"):
                curve = HopfCurve(system, self.names, self.span, self.interval, hopf)
                first = curve.first()
                self.starts[value].append((hopf, curve.state(first).side != 0))
                if not any(passes(other, hopf, value) for other in self.hopf):
                    self.hopf.append(both_ways(first, partial(self._hopf_pieces, curve)))

    def look_for_folds(self, secondary: bool, progress: Progress) -> None:
        """Find the folds on the branches from the Hopf points, and follow those on no curve found before."""
        name, over = self.names
        branches = [(hopf, value) for value in self.places for hopf, limit in self.starts[value] if limit or secondary]
        onsets = [
            (self._rounded(plane(curve, point)), state.slope)
            for found in self.hopf
            for kind, point, state, curve in found.marks
            if kind == "onset"
        ]
        self.search = replace(self.search, onsets=tuple(onsets))
        waiting: list[tuple[Fold, float]] = []
        each_branch = each(folds_of, self.search, branches, part(progress, HOPF, BRANCHES), "folds on branches")
        for (hopf, value), (folds, why) in zip(branches, each_branch, strict=True):
            waiting += [(fold, value) for fold in folds]
            if why:
                self.notes.append(f"The branch from the Hopf point at {name} = {hopf.value:g}, {over} = {value:g}{why}")
        count, all_folds = processes_asked(), len(waiting)
        while waiting:
            progress(
                f"curves of folds: {all_folds - len(waiting)} of {all_folds} folds",
                1 - (1 - BRANCHES) * len(waiting) / all_folds,
            )
            batch = list[tuple[Fold, float]]()
            while waiting and len(batch) < count:
                if not self._known(waiting[0]):
                    batch.append(waiting[0])
                del waiting[0]
            tasks = [(*one, count > 1) for one in batch]
            for one, found in zip(batch, each(curve_of, self.search, tasks), strict=True):
                self._add(one, found)

    def _known(self, one: tuple[Fold, float]) -> bool:
        """Tell whether a fold lies on a curve found before."""
        return any(passes(other, *one) for other in self.folds)

    def _add(self, one: tuple[Fold, float], found: tuple[Followed, str] | str) -> None:
        """Keep the curve through a fold, unless it is one that was found meanwhile, or a note why there is none."""
        fold, value = one
        if isinstance(found, str):
            where = f"{self.names[0]} = {fold.value:g}, {self.names[1]} = {value:g}"
            self.notes.append(f"The curve through the fold at {where}: {found}")
        elif not self._known(one):
            self.folds.append(with_curve(self.search, fold, value, found[0]))
            self.doubts.append(found[1])

    def _hopf_pieces(self, curve: HopfCurve, start: Point) -> list[Followed]:
        # where another contact is met first, the onset jumps
        return [follow(curve, start, HOPF_TESTS, ("onset",), self.search.longest)]

    def _rounded(self, here: Array) -> Array:
        """Return omega and both parameters, with 0 for what is zero to round-off."""
        size = np.array([0.0, np.ptp(self.span), np.ptp(self.interval)])
        return np.where(np.abs(here) <= ROUND_OFF * size, 0.0, here)

    # --- the chart --------------------------------------------------------------------------------

    def chart(self, secondary: bool) -> Chart:
        """Return what was found."""
        hopf = tuple(self._hopf_curve(found) for found in self.hopf)
        folds = tuple(map(self._fold_curve, self.folds))
        self.notes += filter(None, self.doubts)
        ranges = [not_covered(curves, self.interval) for curves in (folds, hopf)]
        system, (name, over) = self.system, self.names
        units = [system.parameter(n).unit for n in self.names]
        within = f"with {name} from {self.span[0]:g} to {self.span[1]:g}{behind(units[0])}"
        where = "" if secondary else " on branches at which rest loses stability"
        for what, gaps in zip((f"fold{where}", "Hopf point"), ranges, strict=True):
            self.notes += [
                f"No {what} was found for {over} from {a:.6g} to {b:.6g}{behind(units[1])}, {within}." for a, b in gaps
            ]
        if not secondary and any(not limit for starts in self.starts.values() for _, limit in starts):
            self.notes.append(
                "Folds were looked for on branches from Hopf points at which the equilibrium loses its stability only."
            )
        if len(system.groups) > 1:
            self.notes.append("Motions of single groups lead to more folds, also lower ones: see critical_speeds.")
        for curve in (*folds, *hopf):
            kind = {"fold": "folds", "hopf": "Hopf points"}[curve.kind]
            self.notes += [f"A curve of {kind} stops: {end}." for end in curve.ends if end.kind not in EXPECTED]
        texts = [f"{system.parameter(n).description} {n}".strip() for n in self.names]
        kinds = ("hopf", self.hopf), ("fold", self.folds)
        special = [p for kind, many in kinds for f in many for p in self._special(kind, f)]
        return Chart(
            system=system.name,
            parameter=name,
            over=over,
            labels=(label(texts[0], units[0]), label(texts[1], units[1])),
            span=self.span,
            interval=self.interval,
            folds=folds,
            hopf=hopf,
            special=tuple(special),
            without_fold=ranges[0],
            without_hopf=ranges[1],
            notes=tuple(dict.fromkeys(self.notes)),
        )

    def _hopf_curve(self, found: Followed) -> CriticalCurve:
        states, error = found.states, np.array([point.error for point in found.points])
        rest = {"side": np.array([s.side for s in states]), "slope": np.array([s.slope for s in states])}
        character = tuple(_direction(state.onset) for state in states)
        return _curve("hopf", found.planes(), character=character, residual=error, ends=found.ends, **rest)

    def _fold_curve(self, found: Followed) -> CriticalCurve:
        ends, size = list(found.ends), np.array([np.inf, np.ptp(self.span), np.ptp(self.interval)])
        rows = [
            (here, state.extremum, state.slope, point.error)
            for here, state, point in zip(found.planes(), found.states, found.points, strict=True)
        ]
        for at, inner in ((0, 1), (-1, -2)):
            near = None if ends[at].kind in ("closed", "interval") else self.search.onset_near(rows[at][0])
            if near is None:
                continue
            last, slope = near
            place = f"{self.names[1]} = {last[2]:.6g}"
            ends[at] = Ending("onset", f"it ends on a curve of Hopf points, where the onset changes, {place}")
            # there is hardly any contact close to that end: points that are solved to the tolerance may lie beyond it
            while len(rows) > 1 and ((rows[at][0] - last) / size) @ ((last - rows[inner][0]) / size) > 0:
                del rows[at]
            rows.insert(0 if at == 0 else len(rows), (last, rows[at][1], slope, 0.0))
        planes, character, slopes, error = zip(*rows, strict=True)
        side = np.array([1 if extremum == "minimum" else -1 for extremum in character])
        rest = {"slope": np.array(slopes), "character": tuple(character), "residual": np.array(error)}
        return _curve("fold", np.array(planes), side=side, ends=(ends[0], ends[1]), **rest)

    def _special(self, of: str, found: Followed) -> list[ChartPoint]:
        special = []
        for kind, point, state, curve in found.marks:
            name = kind if kind != "onset" else "onset changes" if state.grazing else "Bautin point"
            omega, value, over = self._rounded(plane(curve, point))
            text = f"{MEANING[name].format(self.names[1])}; residual {point.error:.1e}"
            at = {"value": float(value), "over_value": float(over), "omega": float(omega)}
            special.append(ChartPoint(kind=name, curve=of, status=text, **at))
        return special


EXPECTED = ("interval", "closed", "onset")  # endings that need no note
MEANING = {
    "cusp": "two curves of folds meet and end",
    "turning point": "the curve turns back in {}",
    "Bautin point": "the first Lyapunov coefficient changes its sign: sub- and supercritical onset meet",
    "onset changes": "the direction in which the cycles begin at the closing of a gap changes",
}
HOPF_TESTS: dict[str, Test] = {
    "onset": lambda state, point: 0.0 if abs(state.onset) < UNDECIDED else state.onset,
    "turning point": lambda state, point: float(point.tangent[-1]),
}


def _direction(onset: float) -> str:
    side = "subcritical" if onset > 0 else "supercritical"
    return side if abs(onset) >= UNDECIDED else "undecided"


def _curve(kind: str, planes: Array, **others: Any) -> CriticalCurve:
    """Return a curve from its points (omega, value, other value), shape (points, 3), and the other fields."""
    omega, values, over = planes.T
    return CriticalCurve(kind=kind, values=values, over_values=over, omega=omega, **others)
