"""Charts of critical values over two parameters."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines
from hbbogie.results.ending import Ending
from hbbogie.results.netcdf import write
from hbbogie.results.pictures import draw, page

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
SHOWN = 6  # special points shown at most


@dataclass(frozen=True, eq=False, kw_only=True)
class CriticalCurve:
    """A curve of folds or of Hopf points over a second parameter, in the order of its arclength.

    Attributes
    ----------
    kind : {"fold", "hopf"}
    values : ndarray, shape (points,), unit of the first parameter
        Critical value of the first parameter.
    over_values : ndarray, shape (points,), unit of the second parameter
    omega : ndarray, shape (points,), rad/s
    slope : ndarray, shape (points,), unit of the first per unit of the second parameter
        Derivative of the critical value along the curve.
    character : tuple of str
        Of a fold "minimum" or "maximum" of the first parameter over the cycles near by; of a Hopf point
        "supercritical", "subcritical", or "undecided".
    side : ndarray of int, shape (points,)
        Of a fold: 1 where the cycles exist at larger values of the first parameter, -1 at smaller ones. Of a Hopf
        point: 1 where the equilibrium is stable at larger values, -1 at smaller ones, 0 where it is unstable on
        both sides.
    residual : ndarray, shape (points,)
        Largest scaled residual of the equations that define each point.
    ends : (Ending, Ending)
        Why the curve ends where it begins and where it ends.
    """

    kind: str
    values: Array
    over_values: Array
    omega: Array
    slope: Array
    character: tuple[str, ...]
    side: NDArray[np.int_]
    residual: Array
    ends: tuple[Ending, Ending]

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        kind = "folds" if self.kind == "fold" else "Hopf points"
        if not len(self):
            return f"Curve of {kind}: no points"
        kinds = ", ".join(dict.fromkeys(self.character))
        low, high = self.extent
        return lines(
            f"Curve of {kind}: {len(self)} points, {kinds}",
            f"second parameter {low:.6g} to {high:.6g}, critical value {self.values.min():.6g} to "
            f"{self.values.max():.6g}, residual up to {self.residual.max():.1g}",
            *(f"{word}: {end}" for word, end in zip(("begins", "ends"), self.ends, strict=True) if str(end)),
        )

    @property
    def extent(self) -> tuple[float, float]:
        """Smallest and largest value of the second parameter on the curve [its unit]."""
        return float(self.over_values.min()), float(self.over_values.max())


@dataclass(frozen=True, kw_only=True)
class ChartPoint:
    """A point of a chart at which something changes.

    Attributes
    ----------
    kind : {"cusp", "Bautin point", "onset changes", "turning point"}
        Where two folds meet; where the first Lyapunov coefficient changes its sign; where the direction changes in
        which cycles begin at the closing of a gap; where a curve turns back in the second parameter.
    curve : {"fold", "hopf"}
    value, over_value : float, units of the two parameters
    omega : float, rad/s
    status : str
        What it is and how well it is located, a sentence.
    """

    kind: str
    curve: str
    value: float
    over_value: float
    omega: float
    status: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Chart:
    """Curves of folds and of Hopf points in the plane of two parameters.

    Attributes
    ----------
    system : str
    parameter, over : str
        The parameter whose critical values are shown, and the one over which.
    labels : (str, str)
        Both with description and unit, for axes.
    span, interval : (float, float), units of the two parameters
        The window of the chart.
    folds, hopf : tuple of CriticalCurve
    special : tuple of ChartPoint
    without_fold, without_hopf : tuple of (float, float), unit of the second parameter
        Ranges of the second parameter over which none was found in the window.
    notes : tuple of str
        Sentences: these ranges, and what could not be computed and why.
    """

    system: str
    parameter: str
    over: str
    labels: tuple[str, str]
    span: tuple[float, float]
    interval: tuple[float, float]
    folds: tuple[CriticalCurve, ...]
    hopf: tuple[CriticalCurve, ...]
    special: tuple[ChartPoint, ...]
    without_fold: tuple[tuple[float, float], ...]
    without_hopf: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        def ranges(some: tuple[tuple[float, float], ...]) -> str:
            return ", ".join(f"{low:.5g} to {high:.5g}" for low, high in some)

        points = [f"{s.kind} at ({s.over_value:.6g}, {s.value:.6g})" for s in self.special[:SHOWN]]
        return lines(
            f"Chart of {self.system}: {self.labels[0]} over {self.labels[1]} from {self.interval[0]:g} to "
            f"{self.interval[1]:g}",
            f"{len(self.folds)} curves of folds, {len(self.hopf)} of Hopf points, {sum(map(len, self.curves))} points",
            "; ".join(points),
            f"no fold found for {self.over} from {ranges(self.without_fold)}" if self.without_fold else "",
            f"no Hopf point found for {self.over} from {ranges(self.without_hopf)}" if self.without_hopf else "",
            f"{len(self.notes)} sentences in .notes" if self.notes else "",
        )

    def _repr_html_(self) -> str:
        rows = [(s.kind, f"{s.over_value:.6g}", f"{s.value:.6g}") for s in self.special]
        return page(repr(self), [("point", self.over, self.parameter), *rows] if rows else (), "chart", self)

    def plot(self, **options: Any) -> Any:
        """Draw the chart; options and the axes returned as of `hbbogie.plot.chart`."""
        return draw("chart", self, **options)

    @property
    def curves(self) -> tuple[CriticalCurve, ...]:
        """All curves, those of folds first."""
        return (*self.folds, *self.hopf)

    def to_dataset(self) -> xr.Dataset:
        """Return the chart as a labelled dataset: all points in one row, with the number of their curve."""
        import xarray as xr

        curves, first, second = self.curves, self.parameter, self.over
        number = np.concatenate([np.full(len(c), i) for i, c in enumerate(curves)] or [np.empty(0, int)])
        data: dict[str, object] = {"curve": ("point", number.astype(int))}
        for name in ("values", "over_values", "omega", "slope", "side", "residual"):
            label = {"values": first, "over_values": second}.get(name, name)
            parts = [np.asarray(getattr(c, name)) for c in curves]
            data[label] = ("point", np.concatenate(parts) if parts else np.empty(0), {"units": self._unit(name)})
        data["character"] = ("point", np.array([x for c in curves for x in c.character], dtype=str))
        data["kind"] = ("curves", np.array([c.kind for c in curves], dtype=str))
        for name in ("kind", "curve", "status"):
            data[f"special_{name}"] = ("special", np.array([getattr(s, name) for s in self.special], dtype=str))
        for name, label in (("value", first), ("over_value", second), ("omega", "omega")):
            numbers = np.array([getattr(s, name) for s in self.special], dtype=float)
            data[f"special_{label}"] = ("special", numbers, {"units": self._unit(name)})
        attributes = {name: json.dumps(getattr(self, name)) for name in ("labels", "span", "interval", "notes")}
        attributes |= {"ends": json.dumps([[str(end) for end in c.ends] for c in curves])}
        attributes |= {"without_fold": json.dumps(self.without_fold), "without_hopf": json.dumps(self.without_hopf)}
        names = {"system": self.system, "parameter": first, "over": second}
        return xr.Dataset(data, attrs=names | attributes)

    def _unit(self, name: str) -> str:
        """Return the unit of a field of curves or points, those of the parameters from their labels."""
        first, second = (text.rpartition("[")[2].rstrip("]") or "1" for text in self.labels)
        quotient = first if second == "1" else f"({first})/({second})"
        known = {"value": first, "values": first, "over_value": second, "over_values": second, "omega": "rad/s"}
        return known.get(name) or (quotient if name == "slope" else "1")

    def save(self, path: str | Path) -> None:
        """Write the chart to a NetCDF file."""
        write(self.to_dataset(), path)
