"""Distributions of parameters, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, pair, unknown_name

Array = NDArray[np.float64]
WORDS = {"norm": "normal", "truncnorm": "truncated normal", "lognorm": "lognormal", "triang": "triangular"}
DISTRIBUTIONS = ("uniform", "normal", "truncated_normal", "lognormal", "triangular")


def distribution(name: str, given: Any) -> Any:
    """Return the frozen scipy distribution of a parameter: of a pair (low, high) the uniform one."""
    from scipy.stats import uniform

    if hasattr(given, "ppf"):
        return given
    try:
        low, high = (float(v) for v in given)
    except (TypeError, ValueError):
        raise ModelError(
            f"parameter {name!r}: got {given!r}; give (low, high) or a distribution such as scipy.stats.norm(1, 2)."
        ) from None
    low, high = pair(f"parameter {name!r}", (low, high))
    return uniform(low, high - low)


def in_words(given: Any) -> tuple[str, float, float]:
    """Return the name of a frozen distribution, and its quantiles of 5 and 95 %."""
    kind = getattr(getattr(getattr(given, "frozen", given), "dist", None), "name", "a distribution")
    low, high = (float(q) for q in given.ppf(np.array([0.05, 0.95])))
    return WORDS.get(kind, kind), low, high


@dataclass(frozen=True, eq=False)
class Scaled:
    """A distribution in other units.

    Attributes
    ----------
    frozen : distribution of scipy.stats
    factor : float
        Value in the parameter's unit per value of the distribution.
    """

    frozen: Any
    factor: float

    def ppf(self, share: Array) -> Array:
        """Return the quantiles of shares, shape (N,), in the parameter's unit."""
        return self.factor * np.asarray(self.frozen.ppf(share), dtype=float)


def named_distribution(kind: str, values: Mapping[str, float]) -> Any:
    """Return the frozen scipy distribution of a name and its values.

    Parameters
    ----------
    kind : str
        "uniform" (low, high), "normal" (mean, deviation), "truncated_normal" (mean, deviation, low, high),
        "lognormal" (median, deviation of the logarithm), "triangular" (low, mode, high), or any continuous
        distribution of scipy.stats with its own keywords, such as "weibull_min" (c, scale).
    values : mapping from name to float

    Raises
    ------
    ModelError
        For an unknown kind, or values that are missing, unknown or impossible.
    """
    from scipy import stats

    if not isinstance(kind, str):
        raise ModelError(f"distribution = {kind!r}; give a name such as {', '.join(DISTRIBUTIONS)}.")
    makers: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {
        "uniform": (("low", "high"), lambda low, high: stats.uniform(low, high - low)),
        "normal": (("mean", "deviation"), lambda mean, deviation: stats.norm(mean, deviation)),
        "truncated_normal": (
            ("mean", "deviation", "low", "high"),
            lambda mean, deviation, low, high: stats.truncnorm(
                (low - mean) / deviation, (high - mean) / deviation, mean, deviation
            ),
        ),
        "lognormal": (("median", "deviation"), lambda median, deviation: stats.lognorm(deviation, scale=median)),
        "triangular": (
            ("low", "mode", "high"),
            lambda low, mode, high: stats.triang((mode - low) / (high - low), low, high - low),
        ),
    }
    if unbounded := [name for name, value in values.items() if not np.isfinite(value)]:
        raise ModelError(f"distribution {kind!r}: {unbounded[0]} = {values[unbounded[0]]}; give finite numbers.")
    if kind in makers:
        wanted, make = makers[kind]
        if set(values) != set(wanted):
            raise ModelError(f"distribution {kind!r}: got {', '.join(values) or 'nothing'}; give {', '.join(wanted)}.")
    else:
        make = getattr(stats, kind, None)  # type: ignore[assignment]
        if not isinstance(make, stats.rv_continuous):
            known = unknown_name("distribution", kind, DISTRIBUTIONS)
            raise ModelError(f"{known} Or a continuous distribution of scipy.stats, such as weibull_min.")
    try:
        with np.errstate(all="ignore"):
            frozen = make(**values)
            median = float(frozen.ppf(0.5))
    except (TypeError, ValueError, ZeroDivisionError) as error:
        raise ModelError(f"distribution {kind!r} with {dict(values)}: {error}.") from error
    if not np.isfinite(median):
        raise ModelError(
            f"distribution {kind!r} with {dict(values)} has no finite quantiles; check their order and sign."
        )
    return frozen
