"""Critical values of many designs at once: Hopf points, folds, and the evidence if there is no fold."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError
from hbbogie.exact.batch import CHUNK, Fold, Nominal, Start, lessons, quadratics, solve
from hbbogie.exact.carrying import Branches
from hbbogie.exact.folding import null_vectors
from hbbogie.exact.hopf import HopfPoints, hopf_of
from hbbogie.exact.model import SwitchedLinear
from hbbogie.exact.points import Point
from hbbogie.exact.starting import at_grazing, exact_cycle
from hbbogie.exact.walk import Walk, follow
from hbbogie.model.ranges import check_interval, widened
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
_Answer = tuple[Fold | None, str, bool, bool]  # the fold, what was found, whether that failed, whether it is complete
_Above = tuple[list[Walk], tuple[float, float]]  # branches that run above the first Hopf point, and over which window
TOGETHER = 16  # designs beside one whose branches were followed that are tried before those further away
BESIDE = "fold found from that of another design, the branch not followed"
CARRIED = (
    "no fold: the branch runs above its Hopf point to its end as that of a design beside it, at all of whose cycles it "
    "was solved for, and the branches of other Hopf points begin as there; they were not followed by themselves"
)


@dataclass(frozen=True, eq=False)
class CriticalValues:
    """Critical values of D designs.

    Attributes
    ----------
    folds : tuple of D Fold or None
        The lowest fold below the Hopf point, on the branch that begins there; None if there is none.
    hopf : HopfPoints
    status : tuple of D str
        How each fold was found, or why there is none.
    failed : ndarray of bool, shape (D,)
        Whether the search failed, so that it is unknown if there is a fold.
    complete : ndarray of bool, shape (D,)
        Whether the branches from all Hopf points were followed to their ends. They are not where the fold was found
        from the nominal one: there may be a second one, lower.
    """

    folds: tuple[Fold | None, ...]
    hopf: HopfPoints
    status: tuple[str, ...]
    failed: NDArray[np.bool_]
    complete: NDArray[np.bool_]

    __repr__ = brief

    @property
    def fold(self) -> Array:
        """Values of the folds, shape (D,), unit of the parameter; NaN where there is none."""
        return np.array([f.value if f else np.nan for f in self.folds])

    @property
    def fold_omega(self) -> Array:
        """Frequencies of the folds, shape (D,), rad/s."""
        return np.array([f.omega if f else np.nan for f in self.folds])

    @property
    def fold_gradient(self) -> Array:
        """Derivatives of the folds in all parameters, -1 in the parameter itself, shape (D, parameters)."""
        none = np.full(self.hopf.gradient.shape[1], np.nan)
        return np.array([f.gradient if f else none for f in self.folds])


@dataclass(frozen=True, eq=False)
class NominalDesign:
    """The design from which the search for the critical values of other designs begins.

    Attributes
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
        Where Hopf points and folds are looked for.
    start : Point
        The grazing at which its branch begins.
    fold : Nominal or None
        Its fold; None if it has none.
    """

    system: System
    parameter: str
    interval: tuple[float, float]
    start: Point
    fold: Nominal | None

    __repr__ = brief

    def critical_values(self, points: Array) -> CriticalValues:
        """Find the first Hopf point and the fold below it of many designs; see `critical_values`."""
        p = np.array(points, dtype=float)
        if p.ndim != 2 or p.shape[1] != len(self.system.parameters):
            raise ModelError(
                f"critical_values: the points have shape {p.shape}; give one row for each design and one column for "
                f"each of the {len(self.system.parameters)} parameters."
            )
        place, low = self.system.parameter_names.index(self.parameter), self.interval[0]
        p[:, place] = self.start.value
        model, sides = self.start.closing.model, self.start.closing.sequence.states[0]
        hopf = _hopfs(model, p, place, sides, low)
        near = self.fold.near(p) if self.fold else {}
        answers: dict[int, _Answer] = {
            d: (fold, "fold found from the nominal fold, the branch not followed", False, False)
            for d, fold in near.items()
            if hopf.first[d] and low <= fold.value < hopf.value[d]
        }
        lost = self._followed(p, hopf, answers)
        if lost:  # the Hopf points of the search there
            again = _hopfs(model, p[lost], place, sides, low)
            for field in fields(HopfPoints):
                getattr(hopf, field.name)[lost] = getattr(again, field.name)
        rows = [answers[d] for d in range(len(p))]
        given, status, failed, complete = zip(*rows, strict=True) if rows else ((), (), (), ())
        return CriticalValues(given, hopf, status, np.array(failed, dtype=bool), np.array(complete, dtype=bool))

    def _followed(self, p: Array, hopf: HopfPoints, answers: dict[int, _Answer]) -> list[int]:
        """Answer the other designs, one by following its branches, those like it together; return those followed.

        Their values of the parameter are set to those of their first Hopf points.
        """
        place, waiting, lost = self.start.closing.place, [d for d in range(len(p)) if d not in answers], list[int]()
        while waiting:
            d = waiting.pop(0)
            at, answers[d], source = _followed(self.system, self.parameter, p[d], self.interval)
            if at is None:
                hopf.value[d], hopf.first[d] = np.nan, False
            else:
                p[d, place] = at
                lost.append(d)
            like = _nearest(p, d, [i for i in waiting if hopf.first[i]])
            if source and like:
                found = _like(source, p[like], hopf.value[like], self.interval[0])
                answers |= {like[k]: answer for k, answer in found.items()}
                waiting = [i for i in waiting if i not in answers]
        return lost


def nominal_design(system: System, parameter: str, interval: tuple[float, float]) -> NominalDesign:
    """Return the system at its own parameter values as the design from which searches begin.

    Raises
    ------
    ModelError
        When the system is not linear between switchings.
    ConvergenceError
        When it has no Hopf point in the interval.
    """
    low, high = check_interval(system, parameter, interval)
    hopfs = hopf_points(system, parameter, (low, high))
    if not hopfs:
        raise ConvergenceError(
            f"system {system.name!r}: no Hopf point from {low:g} to {high:g} at the system's own parameters; give a "
            "nominal design that has one, or another interval."
        )
    start = at_grazing(system, hopfs[0])
    folds = _below(follow(start, (low, high), step=0.1, coarse=True), hopfs[0].value)
    return NominalDesign(system, parameter, (low, high), start, Nominal(folds[0]) if folds else None)


def _below(walk: Walk, value: float) -> list[Point]:
    """Return the folds of a branch below a value, the lowest first."""
    return sorted((point for point in walk.marked("fold") if point.value < value), key=lambda point: point.value)


def critical_values(system: System, points: Array, parameter: str, interval: tuple[float, float]) -> CriticalValues:
    """Find the first Hopf point and the fold below it of many designs, each with its gradient.

    The folds are solved for together, starting from that of a nominal design. Where this fails, the branches of a
    design are followed from all its Hopf points. What is found there leads to the answers for designs beside it: the
    fold is a start for theirs; branches without a fold are carried over, see `Branches`.

    Parameters
    ----------
    system : System
        Its own parameter values are the nominal design.
    points : ndarray, shape (D, number of parameters)
        All parameters of every design; the entry of ``parameter`` is not used.
    parameter : str
    interval : (float, float), unit of the parameter
        Where Hopf points and folds are looked for.

    Raises
    ------
    ModelError
        When the system is not linear between switchings, or for points of another shape.
    ConvergenceError
        When the nominal design has no Hopf point in the interval.
    """
    return nominal_design(system, parameter, interval).critical_values(points)


def _hopfs(model: SwitchedLinear, p: Array, place: int, sides: Array, low: float) -> HopfPoints:
    """Return the Hopf points of all designs, in chunks; of many, those of a few tell better guesses for the others."""
    forms = quadratics(np.log(np.where(p * p[0] > 0, p, 1.0) / np.where(p * p[0] > 0, p[0], 1.0)))
    first = lessons(forms)
    if len(first):
        told = hopf_of(model, p[first], place, sides, low).value
        known = np.isfinite(told)
        if known.sum() > forms.shape[1]:
            p = p.copy()
            p[:, place] = forms @ np.linalg.lstsq(forms[first][known], told[known], rcond=1e-9)[0]
    parts = [hopf_of(model, p[i : i + CHUNK], place, sides, low) for i in range(0, len(p), CHUNK)]
    return HopfPoints(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(HopfPoints)))


def _nearest(p: Array, d: int, others: list[int]) -> list[int]:
    """Return designs in the order of their distance from one of them, relative to its parameters."""
    far = np.abs(p[others] - p[d]) / np.where(p[d] == 0, 1.0, np.abs(p[d]))
    return [others[k] for k in np.argsort((far**2).sum(axis=1), kind="stable")]


def _like(source: Nominal | _Above, p: Array, hopf: Array, low: float) -> dict[int, _Answer]:
    """Return the answers for the first designs that are like one whose branches were followed, by their numbers."""
    branches = None if isinstance(source, Nominal) else Branches(*source)
    answers: dict[int, _Answer] = {}
    for i in range(0, len(p) if branches is None or branches.usable else 0, TOGETHER):
        q, at = p[i : i + TOGETHER], hopf[i : i + TOGETHER]
        if isinstance(source, Nominal):
            near = source.near(q)
            found: dict[int, _Answer] = {
                d: (fold, BESIDE, False, False) for d, fold in near.items() if low <= fold.value < at[d]
            }
        else:
            assert branches is not None
            found = dict.fromkeys(map(int, np.flatnonzero(branches.above(q, at))), (None, CARRIED, False, False))
        answers |= {i + d: answer for d, answer in found.items()}
        if len(found) < len(q) / 2:  # those further away are less alike
            break
    return answers


def _followed(
    system: System, parameter: str, p: Array, interval: tuple[float, float]
) -> tuple[float | None, _Answer, Nominal | _Above | None]:
    """Follow the branches of one design from all Hopf points.

    Return the value of the first, None where there is none; the answer; and from what that for others may follow: the
    fold, or the branches where none of them goes below that value and all were followed to their ends.

    As in `critical_speeds`, Hopf points beyond the ends of the interval count, since their branches may lead into it.
    """
    one = system.with_parameters(**dict(zip(system.parameter_names, map(float, p), strict=True)))
    low, high = interval
    wide = widened(one, parameter, interval)
    hopfs = hopf_points(one, parameter, wide)
    first = next((hopf.value for hopf in hopfs if low <= hopf.value <= high), None)
    below, walks = list[Point](), list[Walk]()
    said = [] if first is not None else [f"there is no Hopf point from {low:g} to {high:g}"]
    lost = list(hopfs.undecided)
    for hopf in hopfs:
        name = "the branch" if hopf.value == first else f"that of the Hopf point at {hopf.value:.6g}"
        try:
            start = at_grazing(one, hopf)
            walk = follow(start, wide, step=0.1, coarse=True)
        except ConvergenceError as error:
            lost.append(f"{name} could not be begun: {error}")
            continue
        walks.append(walk)
        below += [q for q in _below(walk, high if first is None else first) if q.value >= low]
        slope = "falls" if start.direction < 0 else "rises"
        said.append(f"at its grazing {name} {slope}, {len(walk.points)} points followed; {walk.end}")
        doubt = [q.value for kind in ("fold not located", "not located") for q in walk.marked(kind)]
        lost += [f"{name} turns or changes at {value:.6g} in a way that was not resolved" for value in doubt]
        lost += [] if walk.end.complete else [f"{name} was not followed to its end"]
    fold = min(below, key=lambda q: q.value, default=None)
    found = "fold found by following" if fold else "it is not known whether there is a fold" if lost else "no fold"
    text = f"{found}: {'; '.join([*said, *lost])}"
    if fold:
        nominal = Nominal(fold)
        return first, (_fold_at(fold, nominal), text, False, not lost), nominal
    high_up = first is not None and not lost and min(q.value for walk in walks for q in walk.points[1:]) > first
    return first, (None, text, bool(lost), not lost), (walks, wide) if high_up else None


def _fold_at(point: Point, nominal: Nominal) -> Fold:
    return Fold(point.closing, nominal.start, point.value, point.omega, nominal.gradient)


def fold_near(system: System, orbit: Orbit, parameter: str) -> Fold:
    """Return the exact fold, a minimum of the parameter, near a fold that another method has found.

    Parameters
    ----------
    system : System
    orbit : Orbit
        The cycle at the fold.
    parameter : str

    Raises
    ------
    ModelError
        When the system is not linear between switchings, or the orbit is not one of its cycles.
    ConvergenceError
        When no fold is found from there.
    """
    point = exact_cycle(system, orbit, parameter, free=True)
    v, w = null_vectors(point.at)
    nominal = Nominal(point)
    found = solve(nominal, nominal.p[None], {0: Start(point.closing.sequence, point.y, v[0], w[0])})
    if not found:
        raise ConvergenceError(
            f"system {system.name!r}: no exact fold was found from the cycle at {parameter} = "
            f"{orbit.parameters[parameter]:g}; give one with more harmonics."
        )
    return found[0]
