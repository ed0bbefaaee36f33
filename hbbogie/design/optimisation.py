"""Design: choose parameters within bounds so that the smallest critical value is as high as possible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbbogie.brief import brief
from hbbogie.design.criteria import Limit, Quantity
from hbbogie.design.minimax import Minimum
from hbbogie.design.point import DesignPoint
from hbbogie.design.task import DesignTask
from hbbogie.errors import ModelError, door
from hbbogie.model.system import System
from hbbogie.parallel.processes import interruptions
from hbbogie.progress import Progress, silent
from hbbogie.results.failure import FAILURES, ConvergenceError

FEASIBLE = 1e-6  # sum of the relative violations up to which a design counts as feasible


@dataclass(frozen=True, eq=False)
class Active:
    """A limit or bound that is active at the optimum.

    Attributes
    ----------
    name : str
    kind : {"limit", "bound"}
    limit : float
        The value of the limit or bound.
    unit : str
        Its unit.
    side : {"lower", "upper"}
    multiplier : float
        Gain of the objective, in its own unit, per unit by which the limit is relaxed.
    """

    name: str
    kind: str
    limit: float
    unit: str
    side: str
    multiplier: float

    __repr__ = brief

    @property
    def per_percent(self) -> float:
        """Gain of the objective if the limit is relaxed by one per cent."""
        return self.multiplier * 0.01 * abs(self.limit)


@dataclass(frozen=True, eq=False)
class Start:
    """One start of the search.

    Attributes
    ----------
    parameters : dict of float
        Where the search began.
    value : float
        The objective where it ended; NaN if it failed.
    feasible : bool
        Whether all limits are satisfied there.
    status : str
    """

    parameters: dict[str, float]
    value: float
    feasible: bool
    status: str


@dataclass(frozen=True, eq=False)
class Design:
    """An optimised design.

    Attributes
    ----------
    before, after : DesignPoint
        With the systems and their critical values.
    over : dict of (float, float)
        Bounds of the parameters that were chosen.
    objective : Quantity
    value_before, value : float, unit of the objective
    weights : dict of float
        Weight of each row of the objective at the optimum. The weights add up to 1. There are two or more if several
        critical values are equally low.
    active : tuple of Active
        The active limits and bounds; empty if limits are violated, because multipliers then have no meaning.
    limits : tuple of (name, unit, lower, upper, before, after)
        Every row of every limit; NaN if a row does not exist.
    feasible : bool
        Whether the optimised design satisfies all limits.
    residual : float
        Largest entry of the gradient of the Lagrangian, scaled.
    converged : bool
    status : str
    history : list of tuple
        Objective and sum of the relative violations at each iteration of the best start.
    starts : tuple of Start
    interrupted : bool
        Whether Ctrl-C ended the search, with the best design so far.
    """

    before: DesignPoint
    after: DesignPoint
    over: dict[str, tuple[float, float]]
    objective: Quantity
    value_before: float
    value: float
    weights: dict[str, float]
    active: tuple[Active, ...]
    limits: tuple[tuple[str, str, float, float, float, float], ...]
    feasible: bool
    residual: float
    converged: bool
    status: str
    history: list[tuple[float, float]]
    starts: tuple[Start, ...]
    interrupted: bool = False

    __repr__ = brief

    @property
    def system(self) -> System:
        """The system with the optimised parameters."""
        return self.after.system

    @property
    def parameters(self) -> dict[str, float]:
        """The values chosen, by name."""
        return {name: self.system.values[name] for name in self.over}


@door(system=System, raise_=str)
def optimise(
    system: System,
    *,
    raise_: str = "V",
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[Limit] = (),
    maximise: Quantity | None = None,
    minimise: Quantity | None = None,
    interval: tuple[float, float] | None = None,
    harmonics: int = 15,
    start: Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    iterations: int = 60,
    tolerance: float = 1e-6,
    progress: Progress = silent,
) -> Design:
    """Choose parameters within bounds so that the smallest critical value of another parameter is as high as possible.

    Parameters
    ----------
    system : System
        Its values are the original design, at which the first search begins (moved to the bounds if outside).
    raise_ : str
        The parameter whose critical values, Hopf points and folds, are to be raised.
    over : mapping of (float, float)
        Bounds of the parameters to choose, by name.
    subject_to : sequence of Limit
        Further limits, such as ``Limit(DampingRatio(at=60.0), lower=0.05)``.
    maximise, minimise : Quantity, optional
        A quantity to be raised instead of the smallest critical value, or lowered.
    interval : (float, float), optional, unit of the parameter
        Where critical values are searched for; by default as in `critical_speeds`. The critical value of a design
        without any is the end of the range.
    harmonics : int
        Highest harmonic of the cycles.
    start : mapping from name to float, optional
        Where the first search begins, such as an earlier ``Design.parameters``; by default at the original design.
    starts : int
        Number of searches. All but the first begin at a Latin hypercube of designs within the bounds.
    seed : int
        Seed of the hypercube.
    iterations : int
        Largest number of iterations of each search.
    tolerance : float
        Largest entry of the scaled gradient of the Lagrangian.
    progress : callable
        Called with (message, fraction done or None).

    Returns
    -------
    Design

    Raises
    ------
    ModelError
        For unknown names, bounds that are empty or not allowed, fewer than one start, or both ``maximise`` and
        ``minimise``.
    ConvergenceError
        When the original design cannot be judged, because its critical value lies below the range.

    Notes
    -----
    The smallest of several values has a kink where another one becomes the smallest. The program is therefore to
    maximise t subject to t <= each critical value (`minimise_largest`). Each of these values is smooth and has an exact
    gradient (eq-fold-gradient). Folds are followed from design to design. At the end all branches are traced, and the
    search continues if a lower critical value has appeared. Ctrl-C ends the search at the next report of progress, with
    the best design so far.

    Examples
    --------
    The fold of this system lies at mu = -a^2/4.

    >>> from hbbogie import load_problem
    >>> system = load_problem("bautin").bautin(a=1.0)
    >>> design = optimise(system, raise_="mu", over={"a": (0.5, 1.5)}, interval=(-1.0, 1.0))
    >>> round(design.value_before, 6), round(design.value, 6), round(design.parameters["a"], 6)
    (-0.25, -0.0625, 0.5)
    """
    from scipy.stats import qmc

    if not isinstance(over, Mapping) or any(np.shape(pair) != (2,) for pair in over.values()):
        raise ModelError(f"optimise: over={over!r}; give a pair of bounds for each name, such as {{'K1': (2e6, 5e6)}}.")
    if not (isinstance(starts, int | np.integer) and starts >= 1):
        raise ModelError(f"optimise: starts={starts!r}; give a whole number from 1.")
    with interruptions() as pressed:
        limits = tuple(subject_to)
        task = DesignTask(
            system, raise_, dict(over), limits, maximise, minimise, interval, harmonics, progress, pressed
        )
        before = task.before()
        begin = system.with_parameters(**task.checked(start or {}))
        first = (begin.vector()[task.places] - task.low) / task.width
        designs = [np.clip(first, 0, 1), *qmc.LatinHypercube(len(task.names), rng=seed).random(starts - 1)]
        found: list[Minimum[DesignPoint]] = []
        told: list[Start] = []
        for k, x in enumerate(designs):
            task.stage = f"start {k + 1} of {starts}" if starts > 1 else "optimising"
            try:
                best = task.search(x, None if k or start else before, tolerance, iterations)
            except FAILURES as error:
                if starts == 1:
                    raise
                told.append(Start(task.values(x), float("nan"), False, str(error)))
                continue
            except KeyboardInterrupt:
                if not found:
                    raise
                break
            found.append(best)
            feasible = best.sample.violation <= FEASIBLE
            told.append(Start(task.values(x), task.sign * task.size * best.sample.largest, feasible, best.status))
            if best.interrupted:
                break
        stopped = pressed() > 0
    if not found:
        raise ConvergenceError(f"optimise: none of {starts} starts could be judged; the first: {told[0].status}")
    best = min(found, key=lambda m: (max(m.sample.violation, FEASIBLE), m.sample.largest))
    return _design(task, before, best, tuple(told), stopped)


def _design(
    task: DesignTask, before: DesignPoint, best: Minimum[DesignPoint], starts: tuple[Start, ...], stopped: bool
) -> Design:
    after, system = best.sample.point, task.system
    terms = {term.name: term for term in task.limit_terms(after)}
    active, feasible = [], best.sample.violation <= FEASIBLE
    for name, weight in best.weights.items():
        if name in terms:
            t = terms[name]
            which = "upper" if t.side > 0 else "lower"
            active.append(Active(t.row.name, "limit", t.limit, t.unit, which, weight * task.size / t.size))
    for k, name in enumerate(task.names):
        if best.bounds[k]:
            which, unit = "upper" if best.x[k] > 0.5 else "lower", system.parameter(name).unit
            gain = float(abs(best.bounds[k]) * task.size / task.width[k])
            active.append(Active(name, "bound", task.over[name][which == "upper"], unit, which, gain))
    return Design(
        before=before,
        after=after,
        over={n: (float(a), float(b)) for n, (a, b) in task.over.items()},
        objective=task.objective,
        value_before=task.first,
        value=task.sign * task.size * best.sample.largest,
        weights={n: w for n, w in best.weights.items() if n in best.sample.f},
        active=tuple(active) if feasible else (),
        limits=_limits(task.limits, before, after),
        feasible=feasible,
        residual=best.residual,
        converged=best.converged,
        status=best.status,
        history=[(task.sign * task.size * f, violation) for f, violation, _ in best.history],
        starts=starts,
        interrupted=stopped,
    )


def _limits(
    limits: Sequence[Limit], before: DesignPoint, after: DesignPoint
) -> tuple[tuple[str, str, float, float, float, float], ...]:
    """Return name, unit, limits and values before and after of every row."""
    out = []
    for limit in limits:
        old, new = ({row.name: row.value for row in limit.quantity.rows(point)} for point in (before, after))
        for name in dict.fromkeys([*old, *new]):
            values = old.get(name, float("nan")), new.get(name, float("nan"))
            out.append((name, limit.quantity.unit, limit.lower, limit.upper, *values))
    return tuple(out)
