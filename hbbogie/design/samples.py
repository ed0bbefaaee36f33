"""Critical values at random designs: solved for in batches or one after the other, and Monte Carlo.

Where the system is linear between switchings, the random designs are solved for in batches and in closed form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hbbogie.brief import brief
from hbbogie.design.point import DesignPoint, design_point
from hbbogie.design.robust import Uncertainty, places_of
from hbbogie.errors import ModelError, whole
from hbbogie.exact.critical import NominalDesign, nominal_design
from hbbogie.model.system import System
from hbbogie.progress import Progress, silent
from hbbogie.results.failure import FAILURES, ConvergenceError

Array = NDArray[np.float64]
Solved = DesignPoint | float  # a random design, or the beginning of the range if critical below it, or NaN
TOGETHER = 960  # random designs between two reports of progress
MESSAGE = "random designs"


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Smallest critical values at random designs.

    Attributes
    ----------
    factors : ndarray, shape (count, k)
    values : ndarray, shape (count,), unit of the parameter
        NaN if a value could not be found; the beginning of the range if the critical value lies below it.
    """

    factors: Array
    values: Array

    __repr__ = brief

    @property
    def failed(self) -> int:
        """Number of designs without a value."""
        return int(np.isnan(self.values).sum())

    @property
    def known(self) -> Array:
        """The values found."""
        return self.values[~np.isnan(self.values)]

    def probability_below(self, value: float, confidence: float = 0.95) -> tuple[float, float, float]:
        """Return the share of designs below a value, and the Clopper-Pearson interval of the probability.

        Raises
        ------
        ModelError
            When no design has a value.
        """
        if not len(self.known):
            raise ModelError("Monte Carlo: no design has a critical value; give a wider range.")
        test = stats.binomtest(int((self.known < value).sum()), len(self.known))
        interval = test.proportion_ci(confidence, method="exact")
        return float(test.statistic), float(interval.low), float(interval.high)


def monte_carlo(
    point: DesignPoint, uncertainty: Uncertainty, count: int = 200, seed: int = 0, progress: Progress = silent
) -> MonteCarlo:
    """Find the smallest critical value at random designs about a design.

    The folds of the given design are followed to the random ones, from each to its neighbours. Where the system is
    linear between switchings, the random designs are solved for in batches and their folds are those of exact cycles,
    without harmonics that are left out.

    Parameters
    ----------
    point : DesignPoint
    uncertainty : Uncertainty
    count : int
    seed : int
    progress : callable
        Called with (message, fraction done).
    """
    factors = uncertainty.sample(whole("monte_carlo: count", count), np.random.default_rng(seed))
    values = in_batches(point, uncertainty, factors, progress)[0]
    rest = np.flatnonzero(np.isnan(values))
    solved = one_by_one(point, uncertainty, factors[rest], progress=progress)
    values[rest] = [there.value if isinstance(there, DesignPoint) else there for there in solved]
    return MonteCarlo(factors, values)


def in_batches(point: DesignPoint, uncertainty: Uncertainty, factors: Array, progress: Progress) -> tuple[Array, Array]:
    """Return smallest critical values at random designs in closed form, and their derivatives.

    Returns
    -------
    values : ndarray, shape (count,)
        NaN where a value was not found, or the system has no closed form.
    gradients : ndarray, shape (count, number of parameters)
        In the parameters of the given design.
    """
    places = places_of(point.system, point.parameter, uncertainty)
    p, allowed = _parameters(point.system, places, factors)
    values, gradients = np.full(len(p), np.nan), np.zeros(p.shape)
    numbers = np.flatnonzero(allowed)
    if (nominal := closed_form(point)) is not None:
        for i in range(0, len(numbers), TOGETHER):
            progress(MESSAGE, i / len(numbers))
            some = numbers[i : i + TOGETHER]
            values[some], gradients[some] = _together(nominal, p[some])
    gradients[:, places] *= factors
    return values, gradients


def closed_form(point: DesignPoint) -> NominalDesign | None:
    """Return the design from which batches begin; None where there is none, or no closed form."""
    try:
        return nominal_design(point.system, point.parameter, point.interval)
    except (ModelError, ConvergenceError):
        return None


def one_by_one(
    point: DesignPoint,
    uncertainty: Uncertainty,
    factors: Array,
    before: Sequence[Solved] = (),
    anew: Sequence[int] = (),
    progress: Progress = silent,
) -> list[Solved]:
    """Return random designs with their critical values, one after the other, those near the given design first.

    The folds of each are followed from the same factors before, or from the nearest design that is solved for. Where
    this loses a fold that may be the lowest, all branches of the design are traced.

    Parameters
    ----------
    point : DesignPoint
    uncertainty : Uncertainty
    factors : ndarray, shape (count, k)
    before : sequence of DesignPoint or float, optional
        The random designs of the same factors about another design.
    anew : sequence of int
        Numbers of those whose branches are traced in any case.
    progress : callable
        Called with (message, fraction done).
    """
    system = point.system
    p, allowed = _parameters(system, places_of(system, point.parameter, uncertainty), factors)
    scale = np.where(uncertainty.moments[1] > 0, uncertainty.moments[1], 1.0)
    solved: list[Solved] = [float("nan")] * len(factors)
    known: list[tuple[Array, DesignPoint]] = [(1 / scale, point)]
    for k, d in enumerate(np.argsort(np.linalg.norm((factors - 1) / scale, axis=1))):
        progress(MESSAGE, k / len(factors))
        if not allowed[d]:
            continue
        here = factors[d] / scale
        changed = system.with_parameters(**dict(zip(system.parameter_names, map(float, p[d]), strict=True)))
        nearest = min(known, key=lambda one: float(np.linalg.norm(one[0] - here)))[1]
        same = [there for there in before[d : d + 1] if isinstance(there, DesignPoint)]
        solved[d] = there = _followed(changed, [*same, nearest], d in anew)
        if isinstance(there, DesignPoint):
            known.append((here, there))
    return solved


def _followed(system: System, starts: Sequence[DesignPoint], anew: bool) -> Solved:
    """Return a design as followed from the first of several from which none of its lowest folds is lost."""
    for start in starts:
        H = (start.equations.coefficients.size1_out(0) - 1) // 2
        last = start is starts[-1]
        if not anew and np.array_equal(start.system.vector(), system.vector()):
            return start
        try:
            return design_point(system, start.parameter, start.interval, H, start, anew, follow=not last)
        except ConvergenceError as error:
            if "below" in error.statistics:
                return float(error.statistics["below"])
        except FAILURES:
            pass
    return float("nan")


def _parameters(system: System, places: list[int], factors: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the parameters of random designs, shape (count, number of parameters), and whether they are allowed."""
    p = np.tile(system.vector(), (len(factors), 1))
    p[:, places] *= factors
    low, high = (np.array([q.bounds[side] for q in system.parameters]) for side in (0, 1))
    return p, np.all((p >= low) & (p <= high), axis=1)


def _together(nominal: NominalDesign, p: Array) -> tuple[Array, Array]:
    """Return values and gradients of designs in closed form; NaN where a search failed, or there is no Hopf point."""
    found = nominal.critical_values(p)
    fold, hopf = found.fold, found.hopf.value
    value = np.fmin(fold, hopf)
    gradient = np.where((value == fold)[:, None], found.fold_gradient, found.hopf.gradient)
    gradient[:, nominal.system.parameter_names.index(nominal.parameter)] = 0.0
    return np.where(found.failed, np.nan, value), gradient
