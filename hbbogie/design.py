"""Design: choose parameters within bounds so that the smallest critical value is as high as it can be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hbbogie.criteria import CriticalValue, Limit, Quantity
from hbbogie.cycles import default_reach
from hbbogie.design_point import DesignPoint, Row, design_point
from hbbogie.errors import ConvergenceError, ModelError
from hbbogie.guesses import check_interval
from hbbogie.minimax import Minimum, Sample, minimise_largest
from hbbogie.system import System

Array = NDArray[np.float64]
Progress = Callable[[str, float | None], None]
RESCANS = 3  # times the search begins anew when the range holds a lower critical value than those followed


@dataclass(frozen=True, eq=False)
class Active:
    """Something that holds the optimum where it is.

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
        What the objective gains per unit by which the limit is relaxed, in its own unit.
    """

    name: str
    kind: str
    limit: float
    unit: str
    side: str
    multiplier: float

    @property
    def per_percent(self) -> float:
        """What the objective gains when the limit is relaxed by a hundredth of itself."""
        return self.multiplier * 0.01 * abs(self.limit)


@dataclass(frozen=True, eq=False)
class Start:
    """One start of the search.

    Attributes
    ----------
    parameters : dict of float
        Where it began.
    value : float
        The objective where it ended; NaN where it failed.
    feasible : bool
        Whether all limits are kept there.
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
        Share of each row of the objective in the optimum, adding up to 1: two or more where several critical values
        are equally low.
    active : tuple of Active
        What holds the optimum.
    limits : tuple of (name, unit, lower, upper, before, after)
        Every row of every limit; NaN where a row does not exist.
    residual : float
        Largest entry of the gradient of the Lagrangian, scaled.
    converged : bool
    status : str
    history : list of tuple
        Objective and sum of the relative violations at each iteration of the best start.
    starts : tuple of Start
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
    residual: float
    converged: bool
    status: str
    history: list[tuple[float, float]]
    starts: tuple[Start, ...]

    @property
    def system(self) -> System:
        """The system with the optimised parameters."""
        return self.after.system

    @property
    def parameters(self) -> dict[str, float]:
        """The values chosen, by name."""
        return {name: self.system.values[name] for name in self.over}

    @property
    def feasible(self) -> bool:
        """Whether the optimised design keeps all limits."""
        slack = [1e-6 * max(abs(x) for x in (lo, hi) if np.isfinite(x)) for _, _, lo, hi, _, _ in self.limits]
        return all(
            np.isnan(v) or lo - s <= v <= hi + s for (_, _, lo, hi, _, v), s in zip(self.limits, slack, strict=True)
        )


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
    starts: int = 1,
    seed: int = 0,
    iterations: int = 60,
    tolerance: float = 1e-6,
    progress: Progress | None = None,
) -> Design:
    """Choose parameters within bounds so that the smallest critical value of a parameter is as high as it can be.

    Parameters
    ----------
    system : System
        Its values are the design before, where the first search begins (cut to the bounds).
    raise_ : str
        The parameter whose critical values, Hopf points and folds, are to be raised.
    over : mapping of (float, float)
        Bounds of the parameters to choose, by name.
    subject_to : sequence of Limit
        Further limits, such as ``Limit(DampingRatio(at=60.0), lower=0.05)``.
    maximise, minimise : Quantity, optional
        What is raised instead of the smallest critical value, or lowered.
    interval : (float, float), optional, unit of the parameter
        Where critical values are looked for; as in `critical_speeds` where left out. A design without any has the end
        of the range as its critical value.
    harmonics : int
        Highest harmonic of the cycles.
    starts : int
        Number of searches; the second and further ones begin at random designs within the bounds.
    seed : int
        Of the random designs.
    iterations : int
        At most, of each search.
    tolerance : float
        Largest entry of the scaled gradient of the Lagrangian.
    progress : callable, optional
        Called with (message, fraction done or None).

    Returns
    -------
    Design

    Raises
    ------
    ModelError
        For unknown names, bounds that are empty or not allowed, or both ``maximise`` and ``minimise``.
    ConvergenceError
        When the system's own design cannot be judged: its critical value lies below the range.

    Notes
    -----
    The smallest of several values has a kink where the smallest one changes. So the program is: maximise t subject to
    t <= each critical value (`minimise_largest`), every one of which is smooth, with the exact gradient
    (eq-fold-gradient). Folds are followed from design to design; at the end all branches are traced, and the search goes
    on when a lower critical value has appeared.

    Examples
    --------
    ``optimise(bogie, raise_="V", over={"K1": (2e6, 5e6), "K2": (5e6, 15e6)})``
    """
    task = _Task(system, raise_, dict(over), tuple(subject_to), maximise, minimise, interval, harmonics, progress)
    before = task.before()
    rng = np.random.default_rng(seed)
    # Latin hypercube: each of the random starts has a slice of every parameter to itself
    slices = rng.permuted(np.tile(np.arange(starts - 1.0), (len(task.names), 1)), axis=1).T
    first = (system.vector()[task.places] - task.low) / task.width
    designs = [np.clip(first, 0, 1), *((slices + rng.random(slices.shape)) / max(starts - 1, 1))]
    found: list[Minimum[DesignPoint] | None] = []
    told: list[Start] = []
    for k, x in enumerate(designs):
        task.stage = f"start {k + 1} of {starts}" if starts > 1 else "optimising"
        try:
            best = task.search(x, None if k else before, tolerance, iterations)
            found.append(best)
            feasible = best.sample.violation <= 1e-6
            told.append(Start(task.values(x), task.sign * task.size * best.sample.largest, feasible, best.status))
        except ConvergenceError as error:
            if starts == 1:
                raise
            found.append(None)
            told.append(Start(task.values(x), float("nan"), False, str(error)))
    ended = [m for m in found if m is not None]
    if not ended:
        raise ConvergenceError(f"optimise: none of {starts} starts could be judged; the first: {told[0].status}")
    best = min(ended, key=lambda m: (max(m.sample.violation, 1e-6), m.sample.largest))
    return task.design(before, best, tuple(told))


class _Task:
    """The search in unit variables, with what scales it."""

    def __init__(
        self,
        system: System,
        raise_: str,
        over: dict[str, tuple[float, float]],
        limits: tuple[Limit, ...],
        maximise: Quantity | None,
        minimise: Quantity | None,
        interval: tuple[float, float] | None,
        harmonics: int,
        progress: Progress | None,
    ):
        if maximise is not None and minimise is not None:
            raise ModelError("optimise: got both maximise= and minimise=; give one of them, or none.")
        if not over:
            raise ModelError("optimise: over={} names no parameter to choose; give bounds such as {'K1': (2e6, 5e6)}.")
        self.system, self.parameter, self.over, self.limits = system, system.parameter(raise_).name, over, limits
        self.interval = check_interval(system, raise_, interval or default_reach(system, raise_))
        self.harmonics, self.progress, self.stage = harmonics, progress, "optimising"
        self.objective: Quantity = minimise or maximise or CriticalValue(unit=system.parameter(raise_).unit)
        self.sign = 1.0 if minimise is not None else -1.0
        self.names = list(over)
        for name, (low, high) in over.items():
            allowed = system.parameter(name).bounds
            if name == raise_ or not (allowed[0] <= low < high <= allowed[1] and np.isfinite([low, high]).all()):
                raise ModelError(
                    f"optimise: bounds of {name!r} are ({low:g}, {high:g}); give low < high within ({allowed[0]:g}, "
                    f"{allowed[1]:g}), of another parameter than {raise_!r}."
                )
        self.places = [system.parameter_names.index(n) for n in self.names]
        self.low, self.high = (np.array([float(over[n][i]) for n in self.names]) for i in (0, 1))
        self.width, self.size = self.high - self.low, 1.0

    def values(self, x: Array) -> dict[str, float]:
        """Return the parameter values of a point of the unit cube, bounds exactly."""
        p = np.where(x >= 1, self.high, self.low + self.width * np.clip(x, 0, 1))
        return dict(zip(self.names, map(float, p), strict=True))

    def before(self) -> DesignPoint:
        point = design_point(self.system, self.parameter, self.interval, self.harmonics)
        sizes = [abs(row.value) for row in self.objective.rows(point)]
        self.size = max(sizes, default=1.0) or 1.0
        self.constraints(point)  # its cycles are kept, to begin from
        return point

    def search(self, x: Array, near: DesignPoint | None, tolerance: float, iterations: int) -> Minimum[DesignPoint]:
        """Search from a start, and go on from where it ended while a lower critical value has appeared there."""
        for _ in range(RESCANS):
            best = minimise_largest(self.evaluate, x, near, tolerance=tolerance, iterations=iterations)
            x, near = best.x, None
            if self.evaluate(x, None).largest <= best.sample.largest + 1e-9:
                break
        return best

    def evaluate(self, x: Array, near: DesignPoint | None) -> Sample[DesignPoint]:
        """Return objective and limits at a point of the unit cube, scaled."""
        system = self.system.with_parameters(**self.values(x))
        point = design_point(system, self.parameter, self.interval, self.harmonics, near)
        rows = [(row.name, row, 0.0, self.sign, self.size) for row in self.objective.rows(point)]
        limits = self.constraints(point)
        f, c = ({n: side * (r.value - at) / size for n, r, at, side, size in some} for some in (rows, limits))
        slopes, curvatures = {}, {}
        for name, row, _, side, size in (*rows, *limits):
            slopes[name] = side * row.gradient[self.places] * self.width / size
            if row.hessian is not None:
                curvatures[name] = partial(self._curvature, row.hessian, side / size)
        if self.progress:
            self.progress(f"{self.stage}: {self.parameter} = {point.value:.5g}", None)
        return Sample(f, c, slopes, point, curvatures)

    def _curvature(self, hessian: Callable[[Sequence[str]], Array], factor: float) -> Array:
        return factor * hessian(self.names) * np.outer(self.width, self.width)

    def constraints(self, point: DesignPoint) -> list[tuple[str, Row, float, float, float]]:
        """Return name, row, limit, side (1 upper, -1 lower) and scale of every limit that has a row here."""
        found = []
        for k, limit in enumerate(self.limits):
            for row in limit.quantity.rows(point):
                for side, bound in ((1.0, limit.upper), (-1.0, limit.lower)):
                    if np.isfinite(bound):
                        size = abs(bound) or 1.0
                        found.append((f"{row.name} {'upper' if side > 0 else 'lower'} {k}", row, bound, side, size))
        return found

    def design(self, before: DesignPoint, best: Minimum[DesignPoint], starts: tuple[Start, ...]) -> Design:
        after = best.sample.point
        rows = {name: rest for name, *rest in self.constraints(after)}
        units = {f"{k}": limit.quantity.unit for k, limit in enumerate(self.limits)}
        active = []
        for name, weight in best.weights.items():
            if name in rows:
                row, limit, side, size = rows[name]
                gain, which = weight * self.size / size, "upper" if side > 0 else "lower"
                active.append(Active(row.name, "limit", limit, units[name.split()[-1]], which, gain))
        for name, multiplier, width in zip(self.names, best.bounds, self.width, strict=True):
            if multiplier:
                which = "upper" if best.x[self.names.index(name)] > 0.5 else "lower"
                limit, unit = self.over[name][which == "upper"], self.system.parameter(name).unit
                active.append(Active(name, "bound", limit, unit, which, abs(multiplier) * self.size / width))
        first, last = (self.sign * max(self.sign * r.value for r in self.objective.rows(p)) for p in (before, after))
        history = [(self.sign * self.size * f, violation) for f, violation, _ in best.history]
        weights = {n: w for n, w in best.weights.items() if n in best.sample.f}
        table = self._limits(before, after)
        over = {n: (float(a), float(b)) for n, (a, b) in self.over.items()}
        return Design(
            before, after, over, self.objective, first, last, weights, tuple(active), table,
            best.residual, best.converged, best.status, history, starts,
        )  # fmt: skip

    def _limits(
        self, before: DesignPoint, after: DesignPoint
    ) -> tuple[tuple[str, str, float, float, float, float], ...]:
        out = []
        for limit in self.limits:
            values = [{row.name: row.value for row in limit.quantity.rows(point)} for point in (before, after)]
            for name in dict.fromkeys([*values[0], *values[1]]):
                both = (v.get(name, float("nan")) for v in values)
                out.append((name, limit.quantity.unit, limit.lower, limit.upper, *both))
        return tuple(out)
