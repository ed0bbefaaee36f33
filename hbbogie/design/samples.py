"""Critical values at random designs: Monte Carlo, and a quantile of them with its gradient.

Where the system is linear between switchings, the random designs are solved for in batches and in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hbbogie.brief import brief
from hbbogie.design.point import DesignPoint, Row, design_point
from hbbogie.design.robust import Uncertainty, places_of
from hbbogie.errors import ModelError, whole
from hbbogie.exact.critical import NominalDesign, nominal_design
from hbbogie.progress import Progress, silent
from hbbogie.results.failure import FAILURES, ConvergenceError

Array = NDArray[np.float64]
TOGETHER = 960  # random designs between two reports of progress


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

    The search begins at the folds of the given design. Where the system is linear between switchings, the random
    designs are solved for in batches and their folds are those of exact cycles, without harmonics that are left out.

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
    return MonteCarlo(factors, _sampled(point, uncertainty, factors, progress)[0])


@dataclass(frozen=True, eq=False)
class SampledQuantile:
    """A quantile of the smallest critical value over random designs, for `optimise` to raise.

    It needs no approximation of the critical values, which may change between folds and Hopf points. The factors are
    the same at every design, so that the quantile is a continuous function of the design.

    Attributes
    ----------
    uncertainty : Uncertainty
    q : float
        Such as 0.05: the value that is exceeded with a probability of 95 %.
    count : int
        Random designs. In closed form 10,000 take about 20 s of processor time; other systems need fewer.
    seed : int
    unit : str

    Notes
    -----
    The quantile is the weighted mean of all ordered values by Harrell and Davis, and its gradient the same mean of
    their gradients. A random design without a value counts as one at the beginning of the range.

    References
    ----------
    F. E. Harrell and C. E. Davis, Biometrika 69 (1982) 635-640.
    """

    uncertainty: Uncertainty
    q: float = 0.05
    count: int = 10_000
    seed: int = 0
    unit: str = ""

    __repr__ = brief

    def __post_init__(self) -> None:
        if not 0 < self.q < 1:
            raise ModelError(f"SampledQuantile: q = {self.q!r}; give a number between 0 and 1.")
        whole("SampledQuantile: count", self.count)

    @property
    def name(self) -> str:
        """Its name."""
        return f"{100 * self.q:.3g} % quantile"

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the row."""
        factors = self.uncertainty.sample(self.count, np.random.default_rng(self.seed))
        values, gradients = _sampled(point, self.uncertainty, factors, silent)
        unknown = np.isnan(values)
        values, gradients = np.where(unknown, point.interval[0], values), np.where(unknown[:, None], 0.0, gradients)
        order, n = np.argsort(values), self.count
        shares = stats.beta.cdf(np.arange(n + 1) / n, (n + 1) * self.q, (n + 1) * (1 - self.q))
        weights = np.diff(shares)
        return [Row(self.name, float(weights @ values[order]), weights @ gradients[order])]


def _sampled(point: DesignPoint, uncertainty: Uncertainty, factors: Array, progress: Progress) -> tuple[Array, Array]:
    """Return smallest critical values at random designs, and their derivatives in the parameters of the given one.

    Returns
    -------
    values : ndarray, shape (count,)
        NaN if a value could not be found.
    gradients : ndarray, shape (count, number of parameters)
    """
    system, places = point.system, places_of(point.system, point.parameter, uncertainty)
    p = np.tile(system.vector(), (len(factors), 1))
    p[:, places] *= factors
    low, high = (np.array([q.bounds[side] for q in system.parameters]) for side in (0, 1))
    allowed = ((p >= low) & (p <= high)).all(axis=1)
    values, gradients = np.full(len(p), np.nan), np.zeros(p.shape)
    numbers = np.flatnonzero(allowed)
    if (nominal := _nominal(point)) is not None:
        for i in range(0, len(numbers), TOGETHER):
            progress("random designs", i / len(numbers))
            some = numbers[i : i + TOGETHER]
            values[some], gradients[some] = _together(nominal, p[some])
    alone = np.flatnonzero(allowed & np.isnan(values))
    for i, d in enumerate(alone):
        progress("random designs", i / len(alone))
        values[d], gradients[d] = _alone(point, p[d])
    gradients[:, places] *= factors
    return values, gradients


def _nominal(point: DesignPoint) -> NominalDesign | None:
    """Return the design from which batches begin; None where there is none, or no closed form."""
    try:
        return nominal_design(point.system, point.parameter, point.interval)
    except (ModelError, ConvergenceError):
        return None


def _together(nominal: NominalDesign, p: Array) -> tuple[Array, Array]:
    """Return values and gradients of designs in closed form; NaN where a search failed, or there is no Hopf point."""
    found = nominal.critical_values(p)
    fold, hopf = found.fold, found.hopf.value
    value = np.fmin(fold, hopf)
    gradient = np.where((value == fold)[:, None], found.fold_gradient, found.hopf.gradient)
    gradient[:, nominal.system.parameter_names.index(nominal.parameter)] = 0.0
    return np.where(found.failed, np.nan, value), gradient


def _alone(point: DesignPoint, p: Array) -> tuple[float, Array]:
    """Return value and gradient of one design; NaN where a value could not be found."""
    H, system = (point.equations.coefficients.size1_out(0) - 1) // 2, point.system
    none = np.zeros(len(p))
    try:
        changed = system.with_parameters(**dict(zip(system.parameter_names, map(float, p), strict=True)))
        there = design_point(changed, point.parameter, point.interval, H, point)
    except ConvergenceError as error:
        return error.statistics.get("below", np.nan), none
    except FAILURES:
        return np.nan, none
    first = min(there.critical, key=lambda c: c.value, default=None)
    return there.value, none if first is None else there.gradient(first.gradient)
