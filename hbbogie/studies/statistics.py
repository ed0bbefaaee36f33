"""Statistics of a study: probabilities with confidence intervals, sensitivity indices, gradients against samples."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, unknown_name
from hbbogie.studies.dataset import names_of
from hbbogie.studies.optional import required

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
NEGLIGIBLE = 0.05  # a confidence interval of a Sobol index up to this is good enough


@dataclass(frozen=True)
class Exceedance:
    """The probability that an output lies beyond a threshold.

    Attributes
    ----------
    threshold : float, unit of the output
    above : bool
        Whether beyond means above.
    probability : float, dimensionless
        Share of the samples.
    low, high : float, dimensionless
        Confidence interval of Clopper and Pearson, which holds its level for every number of samples.
    confidence : float
    count, total : int
        Samples beyond, and all.
    """

    threshold: float
    above: bool
    probability: float
    low: float
    high: float
    confidence: float
    count: int
    total: int


@dataclass(frozen=True, eq=False)
class Indices:
    """Sobol sensitivity indices of an output.

    Attributes
    ----------
    names : tuple of str
        Of the inputs.
    first, total : ndarray, shape (k,), dimensionless
        Share of the variance that an input makes alone, and with all others together.
    first_error, total_error : ndarray, shape (k,), dimensionless
        Half widths of their confidence intervals, by bootstrap.
    used, dropped : int
        Base points whose every point has a value, and the others.
    """

    names: tuple[str, ...]
    first: Array
    total: Array
    first_error: Array
    total_error: Array
    used: int
    dropped: int

    __repr__ = brief

    @property
    def unsettled(self) -> tuple[str, ...]:
        """Names of the inputs whose confidence interval is wider than an index of theirs that matters."""
        pairs = [(self.first, self.first_error), (self.total, self.total_error)]
        wide = [(error > np.abs(index)) & (error > NEGLIGIBLE) for index, error in pairs]
        return tuple(name for name, *found in zip(self.names, *wide, strict=True) if any(found))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Sampled values of an output beside those that the gradient at the nominal point predicts.

    Attributes
    ----------
    sampled, predicted : ndarray, shape (N,), unit of the output
    nominal : float, unit of the output
    rms, worst : float, unit of the output
        Root mean square and largest error of the prediction.
    explained : float, dimensionless
        Share of the variance of the samples that the prediction explains.
    """

    sampled: Array
    predicted: Array
    nominal: float
    rms: float
    worst: float
    explained: float

    __repr__ = brief


def values_of(data: xr.Dataset, output: str) -> Array:
    """Return a numerical output, or an input, shape (N,); raise `ModelError` where there is none of that name."""
    allowed = [*names_of(data, "outputs"), *names_of(data, "inputs")]
    if output not in allowed:
        raise ModelError(f"study: {unknown_name('output', output, allowed)}")
    values = data[output].values
    if values.dtype.kind not in "fiub":
        raise ModelError(f"study: output {output!r} is text; give one of numbers.")
    return np.asarray(values, dtype=float)


def independent(data: xr.Dataset) -> NDArray[np.bool_]:
    """Tell which points are independent samples, shape (N,): of Saltelli's, two of each block, of others all."""
    points = data["point"].values
    if data.attrs["sampling"] != "saltelli":
        return np.ones(len(points), dtype=bool)
    block = len(names_of(data, "inputs")) + 2
    return np.isin(points % block, (0, block - 1))


def exceedance(values: ArrayLike, threshold: float, above: bool = True, confidence: float = 0.95) -> Exceedance:
    """Return the probability of lying beyond a threshold, with its confidence interval.

    Parameters
    ----------
    values : array_like, shape (N,)
        Independent samples; those that are NaN are left out, infinite ones count. For samples that fill space more
        evenly (Latin hypercube, Sobol sequence) the interval is wider than need be.
    threshold : float, unit of the values
    above : bool
    confidence : float, dimensionless

    Raises
    ------
    ModelError
        When there is no value.
    """
    from scipy.stats import binomtest

    v = np.asarray(values, dtype=float)
    v = v[~np.isnan(v)]
    if not len(v):
        raise ModelError("exceedance: there is no value.")
    count = int(np.count_nonzero(v > threshold if above else v < threshold))
    interval = binomtest(count, len(v)).proportion_ci(confidence, method="exact")
    low, high = float(interval.low), float(interval.high)
    return Exceedance(float(threshold), above, count / len(v), low, high, confidence, count, len(v))


def sobol_indices(data: xr.Dataset, output: str, confidence: float = 0.95, seed: int = 0) -> Indices:
    """Return first-order and total Sobol indices of an output, from a study with Saltelli's points.

    Parameters
    ----------
    data : xarray.Dataset
    output : str
    confidence : float, dimensionless
    seed : int
        Of the bootstrap.

    Raises
    ------
    ModelError
        When the points are of another kind, or too few have a value.
    """
    if data.attrs["sampling"] != "saltelli":
        raise ModelError(
            f"sensitivity: the points are of the kind {data.attrs['sampling']!r}; Sobol indices need 'saltelli' points."
        )
    analyser = required("SALib.analyze.sobol")
    names = names_of(data, "inputs")
    block = len(names) + 2
    everything = np.full(int(data.attrs["total"]), np.nan)
    everything[data["point"].values] = values_of(data, output)
    blocks = everything.reshape(-1, block)
    whole = np.isfinite(blocks).all(axis=1)  # a base point with a missing value is left out with all that belong to it
    if np.count_nonzero(whole) < 8:
        raise ModelError(
            f"sensitivity of {output!r}: only {np.count_nonzero(whole)} base points have all values; at least 8."
        )
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    y = blocks[whole].ravel()
    if np.ptp(y) == 0:
        raise ModelError(f"sensitivity of {output!r}: it does not vary.")
    seeded = {"conf_level": confidence, "seed": seed + 1}  # 0 would be no seed
    found = analyser.analyze(problem, y, calc_second_order=False, **seeded)
    first, total, first_error, total_error = (np.asarray(found[key]) for key in ("S1", "ST", "S1_conf", "ST_conf"))
    used = int(np.count_nonzero(whole))
    return Indices(tuple(names), first, total, first_error, total_error, used, len(whole) - used)


def prediction(data: xr.Dataset, output: str) -> Prediction:
    """Compare the samples with value plus gradient times distance at the nominal point.

    Parameters
    ----------
    data : xarray.Dataset
        Of a job with gradients ``d<output>_d<input>``; for "critical" the gradient of what it is at the nominal point.
    output : str

    Raises
    ------
    ModelError
        When the nominal point failed or has no gradient.
    """
    nominal, inputs = json.loads(data.attrs["nominal_outputs"]), json.loads(data.attrs["nominal_inputs"])
    sampled = values_of(data, output)
    stem = nominal.get("kind", output) if output == "critical" else output
    missing = [n for n in (output, *(f"d{stem}_d{i}" for i in inputs)) if nominal.get(n) is None]
    if missing:
        raise ModelError(f"prediction of {output!r}: the nominal point has no {', '.join(missing[:3])}.")
    distance = np.array([data[i].values - at for i, at in inputs.items()])
    gradient = np.array([nominal[f"d{stem}_d{i}"] for i in inputs])
    predicted = nominal[output] + gradient @ distance
    kept = np.isfinite(sampled)
    sampled, predicted = sampled[kept], predicted[kept]
    error = predicted - sampled
    rms = float(np.sqrt(np.mean(error**2)))
    spread = float(np.var(sampled))
    explained = 1 - rms**2 / spread if spread else float("nan")
    return Prediction(sampled, predicted, float(nominal[output]), rms, float(np.abs(error).max()), explained)
