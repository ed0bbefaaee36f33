"""Parameter points: grids, lists, Latin hypercubes, Sobol sequences, random and Saltelli samples.

The range of each parameter is given by one value. A pair ``(low, high)`` means a uniform distribution, and a frozen
distribution of `scipy.stats` means itself. A grid takes the values themselves.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, door, of_kind, positive, told
from hbbogie.model.system import System
from hbbogie.studies.distributions import distribution, in_words
from hbbogie.studies.optional import required
from hbbogie.units import unit_factor

Array = NDArray[np.float64]
MOST = 10_000_000  # points of a grid
INSIDE = 1e-12  # distance of a quantile from 0 and 1, where many distributions are infinite


@dataclass(frozen=True, eq=False)
class Points:
    """Points in the space of some parameters.

    Attributes
    ----------
    names : tuple of str
        Of the parameters that vary.
    values : ndarray, shape (N, number of names), unit of each parameter
    kind : str
        How the points were made, such as "grid" or "sobol".
    seed : int or None
        With which the same points are made again.
    units : mapping from name to str
        Of parameters whose values are in another unit than their own, until `of_system` has converted them.
    drawn : mapping from name to (str, float, float)
        What each was drawn from: the name of the distribution and its quantiles of 5 and 95 % [unit of the parameter].
    """

    names: tuple[str, ...]
    values: Array
    kind: str
    seed: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    drawn: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)

    __repr__ = brief

    def __post_init__(self) -> None:
        if not self.names or len(self.values) == 0:
            raise ModelError("points: there is no parameter, or no point; give at least one of both.")
        if len(set(self.names)) != len(self.names):
            raise ModelError(f"points: a parameter is named twice among {', '.join(self.names)}.")
        if not np.isfinite(self.values).all():
            bad = self.names[int(np.flatnonzero(~np.isfinite(self.values).all(axis=0))[0])]
            raise ModelError(f"points: parameter {bad!r} has a value that is not finite.")

    def __len__(self) -> int:
        return len(self.values)

    def point(self, i: int) -> dict[str, float]:
        """Return point i as parameter values by name."""
        return dict(zip(self.names, map(float, self.values[i]), strict=True))

    def of_system(self, system: System) -> Points:
        """Return the points in the units of a system.

        Raises
        ------
        ModelError
            Where the system has no such parameter, or does not allow one of the values or units.
        """
        factors = []
        for name in self.names:
            own = system.parameter(name).unit
            given = self.units.get(name, own)
            factors.append(unit_factor("" if not own and given in ("1", "-") else given, own, name))
        found = replace(self, values=self.values * factors, units={})
        for name, column in zip(found.names, found.values.T, strict=True):
            for value in (column.min(), column.max()):
                system.with_parameters(**{name: float(value)})
        return found


def as_points(points: Points | Mapping[str, Any] | Sequence[Mapping[str, float]]) -> Points:
    """Return points as they are, of a mapping the grid, of a sequence of mappings the list."""
    if isinstance(points, Points):
        return points
    if isinstance(points, Mapping):
        return grid(points)
    if isinstance(points, Sequence) and not isinstance(points, str):
        return listed(points)
    raise ModelError(
        f"points: got {told(points)}; give a mapping from name to values, a list of mappings, or what `sobol` returns."
    )


def grid(axes: Mapping[str, Any]) -> Points:
    """Return all combinations of values, the last parameter varying fastest.

    Parameters
    ----------
    axes : mapping from name to values, shape (k,), unit of the parameter
    """
    if isinstance(axes, Mapping) and not axes:
        raise ModelError("grid: no parameter; give the values of at least one, such as {'lam': [0.02, 0.05]}.")
    of_kind("grid", axes, Mapping)
    columns = [_axis(name, v) for name, v in axes.items()]
    if (count := math.prod(map(len, columns))) > MOST:
        raise ModelError(f"grid: {count:.3g} points; give {MOST:g} at most, or take `sobol` or `latin_hypercube`.")
    mesh = np.meshgrid(*columns, indexing="ij")
    return Points(tuple(axes), np.stack([m.ravel() for m in mesh], axis=1), "grid")


def _axis(name: str, given: Any) -> Array:
    """Return the values of a parameter of a grid, shape (k,)."""
    try:
        values = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        values = np.empty((0, 0))
    if values.ndim != 1:
        raise ModelError(f"grid: parameter {name!r}: got {told(given)}; give a list of numbers.")
    return values


def listed(rows: Iterable[Mapping[str, float]]) -> Points:
    """Return points as they are listed; every one names the same parameters."""
    rows = list(rows)
    for i, row in enumerate(rows):
        if not isinstance(row, Mapping):
            raise ModelError(f"list of points: point {i} is {row!r}; give parameter values by name.")
    names = tuple(rows[0]) if rows else ()
    for i, row in enumerate(rows):
        if set(row) != set(names):
            raise ModelError(
                f"list of points: point {i} names {', '.join(row)}; the first one names {', '.join(names)}."
            )
        for name, value in row.items():
            if isinstance(value, str) or np.ndim(value) or not isinstance(value, SupportsFloat):
                raise ModelError(f"list of points: point {i}: {name!r} is {value!r}; give a number.")
    return Points(names, np.array([[float(row[n]) for n in names] for row in rows]), "list")


def from_csv(path: str | Path) -> Points:
    """Return the points of a CSV file whose header names the parameters.

    A ``[unit]`` behind a name is the one the values are in, such as ``K2 [MN/m]``; without it they are in the
    parameter's own.

    Raises
    ------
    ModelError
        When there is no such file, a parameter has two columns, or a field is not a number: the message names its
        line.
    """
    if not Path(path).is_file():
        raise ModelError(f"no file {str(path)!r} with points.")
    try:
        text = Path(path).read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{str(path)!r} cannot be read as text in UTF-8: {error}.") from error
    with StringIO(text, newline="") as file:
        reader = csv.reader(file)
        header = [re.fullmatch(r"\s*([^\[]*?)\s*(?:\[(.*)\]\s*)?", cell) for cell in next(reader, [])]
        names = [found[1] if found else "" for found in header]
        units = {found[1]: found[2].strip() for found in header if found and found[2] is not None}
        if twice := [n for n in dict.fromkeys(names) if names.count(n) > 1]:
            raise ModelError(f"{path}, line 1: {', '.join(map(repr, twice))} has more than one column; leave one.")
        rows = []
        for cells in filter(None, reader):  # but for empty lines
            try:
                rows.append({n: float(c) for n, c in zip(names, cells, strict=True)})
            except ValueError:
                raise ModelError(
                    f"{path}, line {reader.line_num}: got {', '.join(cells)}; give {len(names)} numbers, one for each "
                    f"of {', '.join(names)}."
                ) from None
    return replace(listed(rows), units=units)


@door(system=System)
def around(system: System, share: float, names: Sequence[str] | None = None) -> dict[str, tuple[float, float]]:
    """Return the ranges from (1 - share) to (1 + share) times the system's values.

    Parameters
    ----------
    system : System
    share : float, dimensionless
        Such as 0.2 for plus and minus 20 %.
    names : sequence of str, optional
        All parameters that enter an equation and are not zero where left out.
    """
    share = positive("around: share, such as 0.2 for plus and minus 20 %", share, "1")
    if names is None:
        names = [n for n, v in system.values.items() if v and n not in system.inactive_parameters]
    found = {}
    for name in names:
        value = system.values[system.parameter(name).name]
        low, high = sorted((value * (1 - share), value * (1 + share)))
        found[name] = (low, high)
    return found


def latin_hypercube(distributions: Mapping[str, Any], count: int, seed: int = 0) -> Points:
    """Return a Latin hypercube: each parameter has exactly one point in each of ``count`` equally likely strata.

    Parameters
    ----------
    distributions : mapping from name to (low, high) or a frozen distribution of scipy.stats
        In the unit of the parameter.
    count : int
    seed : int
    """
    from scipy.stats import qmc

    number = _count(distributions, count)
    return _mapped(distributions, qmc.LatinHypercube(len(distributions), rng=_seed(seed)).random(number), "lhs", seed)


def sobol(distributions: Mapping[str, Any], count: int, seed: int = 0) -> Points:
    """Return the first points of a scrambled Sobol sequence.

    Parameters
    ----------
    distributions : mapping from name to (low, high) or a frozen distribution of scipy.stats
        In the unit of the parameter.
    count : int
        A power of two keeps the balance of the sequence; another number is filled up and cut.
    seed : int
    """
    from scipy.stats import qmc

    number = _count(distributions, count)
    exponent = int(np.ceil(np.log2(number)))
    cube = qmc.Sobol(len(distributions), rng=_seed(seed)).random_base2(exponent)[:number]
    return _mapped(distributions, cube, "sobol", seed)


def random(distributions: Mapping[str, Any], count: int, seed: int = 0) -> Points:
    """Return independent random points.

    Parameters
    ----------
    distributions : mapping from name to (low, high) or a frozen distribution of scipy.stats
        In the unit of the parameter.
    count : int
    seed : int
    """
    cube = np.random.default_rng(_seed(seed)).random((_count(distributions, count), len(distributions)))
    return _mapped(distributions, cube, "random", seed)


def saltelli(distributions: Mapping[str, Any], count: int, seed: int = 0) -> Points:
    """Return the sample that Sobol sensitivity indices need: ``count (k + 2)`` points of k parameters.

    Parameters
    ----------
    distributions : mapping from name to (low, high) or a frozen distribution of scipy.stats
        In the unit of the parameter.
    count : int
        Of base points; a power of two.
    seed : int

    References
    ----------
    A. Saltelli et al., Computer Physics Communications 181 (2010) 259-270; as implemented by SALib.
    """
    sampler = required("SALib.sample.sobol")
    number = _count(distributions, count)
    if number & (number - 1):
        raise ModelError(f"saltelli: count = {count}; give a power of two, such as {2 ** int(np.log2(number) + 1)}.")
    k = len(distributions)
    problem = {"num_vars": k, "names": list(distributions), "bounds": [[0.0, 1.0]] * k}
    cube = sampler.sample(problem, number, calc_second_order=False, seed=_seed(seed))
    return _mapped(distributions, cube, "saltelli", seed)


def _seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise ModelError(f"points: seed = {seed!r}; give a whole number of at least 0.")
    return int(seed)


def _count(distributions: Mapping[str, Any], count: float) -> int:
    """Return a number of points, of at least one parameter, as an integer."""
    of_kind("points", distributions, Mapping)
    if not distributions:
        raise ModelError("points: no parameter; give the range or distribution of at least one.")
    if not isinstance(count, int | float | np.number) or not 1 <= count < np.inf or count != int(count):
        raise ModelError(f"points: count = {count!r}; give a whole number of at least 1.")
    if count > MOST:
        raise ModelError(f"points: count = {count:g}; give {MOST:g} at most.")
    return int(count)


def _mapped(distributions: Mapping[str, Any], cube: Array, kind: str, seed: int) -> Points:
    """Return the points of the unit cube through the quantile functions."""
    frozen = {name: distribution(name, d) for name, d in distributions.items()}
    columns = [
        np.asarray(d.ppf(np.clip(u, INSIDE, 1 - INSIDE)), dtype=float)
        for d, u in zip(frozen.values(), cube.T, strict=True)
    ]
    drawn = {name: in_words(d) for name, d in frozen.items()}
    return Points(tuple(distributions), np.stack(columns, axis=1), kind, seed, drawn=drawn)


METHODS: dict[str, Callable[[Mapping[str, Any], int, int], Points]] = {
    "latin_hypercube": latin_hypercube,
    "sobol": sobol,
    "random": random,
    "saltelli": saltelli,
}
