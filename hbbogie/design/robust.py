"""Critical values under uncertain parameters: moments from exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hbbogie.brief import brief
from hbbogie.design.point import DesignPoint, Row, critical_rows
from hbbogie.errors import ModelError, as_number, told
from hbbogie.model.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Random factors by which parameters are multiplied.

    Parameters
    ----------
    factors : mapping from name to a frozen distribution of scipy.stats
        Distribution of the factor, such as ``norm(1, 0.05)``, ``lognorm(0.1)`` or ``uniform(0.8, 0.4)``.
    correlation : array_like, shape (k, k), optional
        Correlation of the factors, in their order, if all are normal. By default they are independent.

    Examples
    --------
    >>> from scipy import stats
    >>> scatter = Uncertainty({"f11": stats.norm(1, 0.1), "lam": stats.uniform(0.8, 0.4)})
    >>> scatter.sample(1000, np.random.default_rng(1)).shape
    (1000, 2)
    """

    factors: Mapping[str, Any]
    correlation: ArrayLike | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        k = len(self.factors)
        if not k:
            raise ModelError("Uncertainty: factors={} names no parameter; give a distribution for at least one.")
        for name, given in self.factors.items():
            if not (hasattr(given, "ppf") and hasattr(given, "dist")):
                raise ModelError(
                    f"Uncertainty: the factor of {name!r} is {told(given)}; give a frozen distribution of scipy.stats, "
                    "such as norm(1, 0.05)."
                )
        moments = np.array([d.stats(moments="mvsk") for d in self.factors.values()], dtype=float)
        if not np.isfinite(moments).all():
            name = [*self.factors][int(np.argmin(np.isfinite(moments).all(axis=1)))]
            raise ModelError(f"Uncertainty: the factor of {name!r} has no finite moments up to the fourth.")
        if self.correlation is None:
            return
        C = np.asarray(self.correlation, dtype=float)
        normal = all(d.dist.name == "norm" for d in self.factors.values())
        proper = C.shape == (k, k) and np.allclose(C, C.T) and np.allclose(np.diag(C), 1)
        if not (normal and proper and np.linalg.eigvalsh(C).min() > 0):
            raise ModelError(
                f"Uncertainty: correlation needs normal factors and a positive definite symmetric matrix of shape "
                f"({k}, {k}) with ones on its diagonal."
            )

    @property
    def moments(self) -> tuple[Array, Array, Array, Array]:
        """Mean minus 1, standard deviation, skewness and kurtosis of the factors, each of shape (k,)."""
        m, v, s, e = np.array([d.stats(moments="mvsk") for d in self.factors.values()], dtype=float).T
        return m - 1, np.sqrt(v), s, e + 3

    @property
    def root(self) -> Array:
        """Matrix T, shape (k, k), such that the factors are their mean plus T times independent standard variables."""
        sd = self.moments[1]
        return (
            np.diag(sd) if self.correlation is None else sd[:, None] * np.linalg.cholesky(np.asarray(self.correlation))
        )

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Return random factors, shape (count, k)."""
        if self.correlation is not None:
            return np.asarray(1 + self.moments[0] + rng.standard_normal((count, len(self.factors))) @ self.root.T)
        return np.column_stack([d.rvs(count, random_state=rng) for d in self.factors.values()])

    def evenly(self, count: int, seed: int = 0) -> Array:
        """Return factors that fill their distribution evenly: quantiles of a Sobol sequence, shape (count, k).

        A mean over them converges faster with their number than over independent ones.
        """
        cube = stats.qmc.Sobol(len(self.factors), rng=seed).random_base2(int(np.ceil(np.log2(count))))[:count]
        cube = np.maximum(cube, 1e-12)  # at 0 many distributions are infinite
        if self.correlation is not None:
            return np.asarray(1 + self.moments[0] + stats.norm.ppf(cube) @ self.root.T)
        return np.column_stack([d.ppf(u) for d, u in zip(self.factors.values(), cube.T, strict=True)])


@dataclass(frozen=True, eq=False)
class Spread:
    """A critical value as a function of the uncertain factors, to second order about the design.

    Attributes
    ----------
    name : str
    value : float
        At the design.
    slopes : ndarray, shape (k,), unit of the value
        Derivatives in the factors.
    curvatures : ndarray, shape (k, k), unit of the value
        Second derivatives.
    uncertainty : Uncertainty
    """

    name: str
    value: float
    slopes: Array
    curvatures: Array
    uncertainty: Uncertainty

    __repr__ = brief

    @property
    def first_order(self) -> tuple[float, float]:
        """Mean and standard deviation of the linear approximation."""
        shift = self.uncertainty.moments[0]
        return float(self.value + self.slopes @ shift), float(np.linalg.norm(self.uncertainty.root.T @ self.slopes))

    @property
    def second_order(self) -> tuple[float, float]:
        """Exact mean and standard deviation of the quadratic approximation."""
        shift, _, skewness, kurtosis = self.uncertainty.moments
        T, h = self.uncertainty.root, self.curvatures
        a, h = T.T @ (self.slopes + h @ shift), T.T @ h @ T
        d = np.diag(h)
        mean = self.value + self.slopes @ shift + 0.5 * shift @ self.curvatures @ shift + 0.5 * d.sum()
        mixed = 0.5 * ((h**2).sum() - (d**2).sum())
        variance = a @ a + (a * d) @ skewness + 0.25 * d**2 @ (kurtosis - 1) + mixed
        return float(mean), float(np.sqrt(max(variance, 0.0)))

    def predict(self, factors: Array) -> Array:
        """Return the quadratic approximation at factors of shape (count, k), shape (count,)."""
        x = factors - 1
        return np.asarray(self.value + x @ self.slopes + 0.5 * np.einsum("ci,ij,cj->c", x, self.curvatures, x))

    @property
    def shares(self) -> dict[str, float]:
        """Share of each factor in the variance of the linear approximation [1]; if independent, they add up to 1."""
        part = (self.uncertainty.root.T @ self.slopes) ** 2
        return dict(zip(self.uncertainty.factors, map(float, part / max(part.sum(), 1e-300)), strict=True))


def spreads(point: DesignPoint, uncertainty: Uncertainty) -> list[Spread]:
    """Return every critical value at a design as a function of the uncertain factors.

    Parameters
    ----------
    point : DesignPoint
    uncertainty : Uncertainty
    """
    system, names = point.system, list(uncertainty.factors)
    places = places_of(system, point.parameter, uncertainty)
    p = system.vector()[places]
    found = []
    for row, c in critical_rows(point):
        if c is not None and row.hessian is not None:
            found.append(
                Spread(row.name, row.value, row.gradient[places] * p, row.hessian(names) * np.outer(p, p), uncertainty)
            )
    return found


def places_of(system: System, parameter: str, uncertainty: Uncertainty) -> list[int]:
    """Return the places of the uncertain parameters among those of the system.

    Raises
    ------
    ModelError
        Where a parameter is unknown, or a factor takes it out of its bounds with a probability of 0.1 % or more.
    """
    if parameter in uncertainty.factors:
        raise ModelError(f"Uncertainty: {parameter!r} is the parameter whose critical values are computed.")
    for name, factor in uncertainty.factors.items():
        (low, high), value = system.parameter(name).bounds, system.values[name]
        ends = sorted(value * float(factor.ppf(q)) for q in (0.001, 0.999))
        if not low <= ends[0] <= ends[1] <= high:
            raise ModelError(
                f"Uncertainty: the factor of {name!r} takes it from {ends[0]:.4g} to {ends[1]:.4g} (quantiles of 0.1 "
                f"and 99.9 %), but its bounds are ({low:g}, {high:g}); give a narrower distribution, or one with ends "
                "such as scipy.stats.truncnorm."
            )
    return [system.parameter_names.index(name) for name in uncertainty.factors]


@dataclass(frozen=True, eq=False)
class RobustValue:
    """Mean minus k standard deviations of every critical value, to first order in the uncertain factors.

    Attributes
    ----------
    uncertainty : Uncertainty
    k : float
        With normal scatter the value is exceeded with probability Phi(k): 97.7 % for k = 2 (see `quantile`).
    unit : str

    Notes
    -----
    The gradient uses the second derivatives of the critical value, which are exact (`critical_hessian`).
    """

    uncertainty: Uncertainty
    k: float = 2.0
    unit: str = ""

    __repr__ = brief

    def __post_init__(self) -> None:
        if not np.isfinite(as_number(self.k)):
            raise ModelError(
                f"RobustValue: k = {told(self.k)}; give a finite number of standard deviations, such as 2."
            )

    @classmethod
    def quantile(cls, uncertainty: Uncertainty, q: float, unit: str = "") -> RobustValue:
        """Return the q-quantile of every critical value in the normal approximation, such as q = 0.05.

        Raises
        ------
        ModelError
            Unless 0 < q < 1.
        """
        if not 0 < q < 1:
            raise ModelError(f"RobustValue: quantile {q!r}; give a number between 0 and 1.")
        return cls(uncertainty, -float(stats.norm.ppf(q)), unit)

    @property
    def name(self) -> str:
        """Its name."""
        return f"mean minus {self.k:.3g} sigma"

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the rows."""
        system = point.system
        names = [n for n in system.parameter_names if n != point.parameter]
        uncertain = places_of(system, point.parameter, self.uncertainty)
        columns = [system.parameter_names.index(n) for n in names]
        p, shift, T = system.vector()[uncertain], self.uncertainty.moments[0], self.uncertainty.root
        rows = []
        for row, c in critical_rows(point):
            if c is None or row.hessian is None:
                rows.append(Row(row.name, row.value, row.gradient))
                continue
            a = row.gradient[uncertain] * p
            H = np.zeros((len(a), len(system.parameters)))
            H[:, columns] = row.hessian(names)[[names.index(n) for n in self.uncertainty.factors]] * p[:, None]
            H[np.arange(len(a)), uncertain] += row.gradient[uncertain]  # both factors of dV/dp_j p_j depend on p_j
            sigma = float(np.linalg.norm(T.T @ a))
            slope = (T @ (T.T @ a)) @ H / sigma if sigma else np.zeros(H.shape[1])
            rows.append(
                Row(row.name, float(row.value + a @ shift - self.k * sigma), row.gradient + shift @ H - self.k * slope)
            )
        return rows


def predicted(found: list[Spread], count: int = 100_000, seed: int = 0) -> Array:
    """Return the smallest of all quadratic approximations at random factors, shape (count,).

    Parameters
    ----------
    found : list of Spread
    count, seed : int
    """
    factors = found[0].uncertainty.sample(count, np.random.default_rng(seed))
    return np.asarray(np.min([f.predict(factors) for f in found], axis=0))


def predicted_below(found: list[Spread], value: float, count: int = 100_000, seed: int = 0) -> tuple[float, float]:
    """Return the probability that the smallest critical value lies below a value, to first and second order.

    Parameters
    ----------
    found : list of Spread
    value : float
    count : int
        Number of samples of the quadratic approximation. The linear one is taken as normal.
    seed : int

    Returns
    -------
    first, second : float
        The first considers only the critical value with the lowest mean minus standard deviation.
    """
    first = max(
        float(stats.norm.cdf((value - m) / s)) if s else float(m < value) for m, s in (f.first_order for f in found)
    )
    return first, float((predicted(found, count, seed) < value).mean())
