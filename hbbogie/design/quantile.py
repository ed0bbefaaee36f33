"""A quantile of the smallest critical value over random designs, with its gradient, to be raised by a search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hbbogie.brief import brief
from hbbogie.critical.curvature import critical_hessian
from hbbogie.design.point import DesignPoint, Row
from hbbogie.design.robust import Uncertainty
from hbbogie.design.samples import closed_form, in_batches, one_by_one
from hbbogie.errors import ModelError, whole
from hbbogie.progress import Progress, silent
from hbbogie.results import Critical

Array = NDArray[np.float64]
MANY, FEW = 10_000, 16  # random designs in closed form, and of other systems, where no count is given
LEAST = 0.01  # weight from which a random design counts for curvature, for what may become lower, and is searched anew
ORDERS = 100  # largest number of orders that are kept
OTHERS = 12  # largest number of selections besides the present one


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
    count : int, optional
        Random designs; 10,000 in closed form, which take about 20 s of processor time, and else 16.
    seed : int
    unit : str
    progress : callable
        Called with (message, fraction done).

    Notes
    -----
    The factors fill their distribution evenly (`Uncertainty.evenly`). The quantile is the weighted mean of all ordered
    values by Harrell and Davis, and its gradient the same mean of their gradients. A random design without a value
    counts as one at the beginning of the range.

    Where two values change places, or another critical value of a random design becomes its smallest, the quantile has
    a kink, on which the best design often lies. The rows are therefore the present selection, which is the smallest of
    all, and those that may become smaller: neighbours exchanged, earlier orders, another critical value.

    Outside closed form each random design is followed from step to step. Where `optimise` searches anew, at the end,
    all branches of those that count are traced.

    References
    ----------
    F. E. Harrell and C. E. Davis, Biometrika 69 (1982) 635-640.
    """

    uncertainty: Uncertainty
    q: float = 0.05
    count: int | None = None
    seed: int = 0
    unit: str = ""
    progress: Progress = silent
    _seen: list[Array] = field(default_factory=list, init=False)  # weights of the random designs at earlier designs

    __repr__ = brief

    def __post_init__(self) -> None:
        if not 0 < self.q < 1:
            raise ModelError(f"SampledQuantile: q = {self.q!r}; give a number between 0 and 1.")
        if self.count is not None:
            whole("SampledQuantile: count", self.count)

    @property
    def name(self) -> str:
        """Its name."""
        return f"{100 * self.q:.3g} % quantile"

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the rows: the quantile first, then what it is if other values count."""
        count = self.count or (MANY if closed_form(point) is not None else FEW)
        factors = self.uncertainty.evenly(count, self.seed)
        values, gradients = in_batches(point, self.uncertainty, factors, self.progress)
        rest = np.flatnonzero(np.isnan(values))
        solved = self._one_by_one(point, factors, rest)
        for d, there in solved.items():
            values[d], gradients[d] = point.interval[0], 0.0
            if isinstance(there, DesignPoint):
                values[d], gradients[d] = there.value, self._gradient(there, factors[d], 0)
            elif not np.isnan(there):
                values[d] = there
        order, shares = np.argsort(values), np.empty(count)
        shares[order] = self._weights(count)
        curvature = cache(partial(self._curvature, solved, factors))

        def row(name: str, shares: Array, value: float, gradient: Array, other: tuple[int, int] = (-1, 0)) -> Row:
            counting = [(int(d), other[1] if d == other[0] else 0) for d in np.flatnonzero(shares > LEAST)]

            def hessian(names: Sequence[str]) -> Array:
                parts = (shares[d] * curvature(d, which, tuple(names)) for d, which in counting)
                return sum(parts, np.zeros((len(names),) * 2))

            known = all(d in solved for d, _ in counting) and len(counting) > 0
            return Row(name, value, gradient, hessian if known else None)

        base = row(self.name, shares, float(shares @ values), shares @ gradients)
        others = []
        for a, b in pairwise(order):
            change = shares[a] - shares[b]
            if change > LEAST:
                swapped = shares.copy()
                swapped[[a, b]] = shares[[b, a]]
                name = f"{self.name}, random designs {a} and {b} exchanged"
                others.append(row(name, swapped, float(swapped @ values), swapped @ gradients))
        for n, earlier in enumerate(self._seen):
            if float(earlier @ values) > base.value:
                name = f"{self.name}, random designs in order {n + 1}"
                others.append(row(name, earlier, float(earlier @ values), earlier @ gradients))
        if len(self._seen) < ORDERS and not any(np.array_equal(shares, earlier) for earlier in self._seen):
            self._seen.append(shares)
        for d, there in solved.items():
            if isinstance(there, DesignPoint) and shares[d] > LEAST:
                for k, c in enumerate(there.critical[1:], 1):
                    value = base.value + shares[d] * (c.value - values[d])
                    gradient = base.gradient + shares[d] * (self._gradient(there, factors[d], k) - gradients[d])
                    name = f"{self.name}, {there.names[k]} of random design {d}"
                    others.append(row(name, shares, value, gradient, (d, k)))
        return [base, *sorted(others, key=lambda r: r.value)[:OTHERS]]

    def _weights(self, count: int) -> Array:
        """Return the weights of ordered values by Harrell and Davis, shape (count,)."""
        steps = np.arange(count + 1) / count
        return np.diff(stats.beta.cdf(steps, (count + 1) * self.q, (count + 1) * (1 - self.q)))

    def _one_by_one(
        self, point: DesignPoint, factors: Array, rest: NDArray[np.int64]
    ) -> dict[int, DesignPoint | float]:
        """Return the random designs of some numbers; they are kept at the design, to be followed from there."""
        key = (self, *map(int, rest))
        before = point.random.get(key, ())
        anew: list[int] = []
        if point.searched and before:  # a search anew, where an earlier one has shown which count
            known = [there.value if isinstance(there, DesignPoint) else -np.inf for there in before]
            anew = [int(i) for i in np.argsort(known)[: int((self._weights(len(factors)) > LEAST).sum())]]
        solved = one_by_one(point, self.uncertainty, factors[rest], before, anew, self.progress)
        point.random[key] = tuple(solved)
        return dict(zip(map(int, rest), solved, strict=True))

    def _gradient(self, there: DesignPoint, factors: Array, k: int) -> Array:
        """Return the derivative of critical value k of a random design in the parameters of the given one."""
        if k >= len(there.critical) or there.critical[k].value > there.interval[1]:
            return np.zeros(len(there.system.parameters))
        return there.gradient(there.critical[k].gradient) * self._by(there, factors, there.system.parameter_names)

    def _curvature(
        self, solved: dict[int, DesignPoint | float], factors: Array, d: int, k: int, names: tuple[str, ...]
    ) -> Array:
        there = solved[d]
        if not isinstance(there, DesignPoint) or k >= len(there.critical):
            return np.zeros((len(names),) * 2)
        c: Critical = there.critical[k]
        by = self._by(there, factors[d], names)
        return critical_hessian(there.equations, c, names) * np.outer(by, by)

    def _by(self, there: DesignPoint, factors: Array, names: Sequence[str]) -> Array:
        """Return by what each parameter of the given design is multiplied in a random one, shape (number of names,)."""
        given = dict(zip(self.uncertainty.factors, factors, strict=True))
        return np.array([given.get(n, 1.0) for n in names])
