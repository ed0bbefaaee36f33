"""The search for a design: a scaled program in unit variables, and its evaluation from design to design."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hbbogie.design.criteria import CriticalValue, Limit, Quantity
from hbbogie.design.minimax import Minimum, minimise_largest
from hbbogie.design.point import DesignPoint, Row, design_point
from hbbogie.design.quadratic_step import Sample
from hbbogie.design.quantile import SampledQuantile
from hbbogie.errors import ModelError, unknown_name
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.progress import Progress
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
CLOSE = 0.02  # longest step, in unit variables, after which a fold that is lost is taken to have vanished
RESCANS = 3  # number of restarts when the range contains a lower critical value than those followed


@dataclass(frozen=True, eq=False)
class Term:
    """A row of the objective or of a limit, as a term of the scaled program: side (value - limit) / size.

    Attributes
    ----------
    name : str
        The same for all designs.
    row : Row
    limit : float
        0 in the objective.
    side : {1.0, -1.0}
        1 if the value is to be small: an upper limit, or an objective that is lowered.
    size : float
    unit : str
        Unit of the row.
    """

    name: str
    row: Row
    limit: float
    side: float
    size: float
    unit: str

    @property
    def value(self) -> float:
        """The term."""
        return self.side * (self.row.value - self.limit) / self.size


class DesignTask:
    """The search in unit variables, with its scales."""

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
        progress: Progress,
        pressed: Callable[[], int],
    ):
        if maximise is not None and minimise is not None:
            raise ModelError("optimise: got both maximise= and minimise=; give one of them, or none.")
        if not over:
            raise ModelError("optimise: over={} names no parameter to choose; give bounds such as {'K1': (2e6, 5e6)}.")
        self.system, self.parameter, self.over, self.limits = system, system.parameter(raise_).name, over, limits
        self.interval = check_interval(system, raise_, interval)
        self.harmonics, self.stage, self.evaluated, self._progress, self._pressed = harmonics, "", 0, progress, pressed
        self.objective: Quantity = minimise or maximise or CriticalValue(unit=system.parameter(raise_).unit)
        if isinstance(self.objective, SampledQuantile):
            self.objective = replace(self.objective, progress=self.progress)
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
        self.width, self.size, self.first = self.high - self.low, 1.0, float("nan")

    def progress(self, message: str, fraction: float | None) -> None:
        """Tell how far the search is; raise `KeyboardInterrupt` if Ctrl-C was pressed, where no library loses it."""
        if self._pressed():
            raise KeyboardInterrupt
        self._progress(message, fraction)

    def values(self, x: Array) -> dict[str, float]:
        """Return the parameter values of a point of the unit cube, exact at the bounds."""
        p = np.where(x >= 1, self.high, self.low + self.width * np.clip(x, 0, 1))
        return dict(zip(self.names, map(float, p), strict=True))

    def checked(self, start: Mapping[str, float]) -> dict[str, float]:
        """Return the values of a start; raise `ModelError` for names that are not to be chosen."""
        for name in start:
            if name not in self.over:
                raise ModelError(
                    f"optimise: start={dict(start)!r}: {unknown_name('parameter to choose', name, self.over)}"
                )
        return dict(start)

    def before(self) -> DesignPoint:
        """Return the original design; set the scale of the objective, and its first value."""
        self.progress("searching for the critical values of the design before", None)
        point = design_point(self.system, self.parameter, self.interval, self.harmonics)
        values = [row.value for row in self.objective.rows(point)]
        self.size = max(map(abs, values), default=1.0) or 1.0
        self.first = self.sign * max((self.sign * value for value in values), default=float("nan"))
        self.limit_terms(point)  # keeps its cycles as starting points
        return point

    def search(self, x: Array, near: DesignPoint | None, tolerance: float, iterations: int) -> Minimum[DesignPoint]:
        """Search from a start, and again from where the search ended as long as lower critical values appear there."""
        for _ in range(RESCANS):
            best = minimise_largest(self.evaluate, x, near, tolerance=tolerance, iterations=iterations)
            x = best.x
            if best.interrupted:
                return best
            try:
                self.progress(f"{self.stage}, searching for all critical values anew", None)
                anew = self.evaluate(x, best.sample.point, anew=True)
            except KeyboardInterrupt:
                status = f"{best.status}, but was interrupted before this was confirmed from scratch"
                return replace(best, converged=False, status=status, interrupted=True)
            except ConvergenceError as error:
                return replace(best, converged=False, status=f"{best.status}, but not confirmed from scratch: {error}")
            if anew.largest <= best.sample.largest + 1e-9 and anew.violation <= best.sample.violation + 1e-6:
                return best
            near = anew.point
        return replace(
            best, converged=False, status=f"{best.status}, but other critical values or cycles keep appearing"
        )

    def evaluate(self, x: Array, near: DesignPoint | None, anew: bool = False) -> Sample[DesignPoint]:
        """Return the scaled objective and limits at a point of the unit cube."""
        system = self.system.with_parameters(**self.values(x))
        far = 0.0
        if near is not None:
            far = np.abs((system.vector() - near.system.vector())[self.places] / self.width).max()
        point = design_point(system, self.parameter, self.interval, self.harmonics, near, anew, bool(far > CLOSE))
        terms, limits = self.objective_terms(point), self.limit_terms(point)
        slopes: dict[str, Array] = {}
        curvatures: dict[str, Callable[[], Array]] = {}
        for term in (*terms, *limits):
            factor = term.side / term.size
            slopes[term.name] = factor * term.row.gradient[self.places] * self.width
            if term.row.hessian is not None:
                curvatures[term.name] = partial(self._curvature, term.row.hessian, factor)
        f, c = ({term.name: term.value for term in some} for some in (terms, limits))
        self.evaluated += 1
        self.progress(f"{self.stage}, design {self.evaluated}, {self.parameter} = {point.value:.5g}", None)
        return Sample(f, c, slopes, point, curvatures)

    def _curvature(self, hessian: Callable[[Sequence[str]], Array], factor: float) -> Array:
        try:
            return factor * hessian(self.names) * np.outer(self.width, self.width)
        except np.linalg.LinAlgError:  # two critical points are about to merge: do without the second derivatives
            return np.zeros((len(self.names), len(self.names)))

    def objective_terms(self, point: DesignPoint) -> list[Term]:
        """Return the terms whose largest is minimised.

        Raises
        ------
        ConvergenceError
            When the objective has no row here, such as the peak of a cycle that does not exist.
        """
        unit, rows = self.objective.unit, self.objective.rows(point)
        if not rows:
            raise ConvergenceError(
                f"the {self.objective.name} has no value where {self.parameter} = {point.value:g} is critical."
            )
        return [Term(row.name, row, 0.0, self.sign, self.size, unit) for row in rows]

    def limit_terms(self, point: DesignPoint) -> list[Term]:
        """Return the terms that must not exceed 0: one for each side of every limit that has a row here."""
        found = []
        for k, limit in enumerate(self.limits):
            for row in limit.quantity.rows(point):
                for side, bound in ((1.0, limit.upper), (-1.0, limit.lower)):
                    if np.isfinite(bound):
                        name = f"limit {k + 1}, {row.name}, {'upper' if side > 0 else 'lower'}"
                        found.append(Term(name, row, bound, side, abs(bound) or 1.0, limit.quantity.unit))
        return found
