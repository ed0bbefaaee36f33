"""Basins of attraction: how every motion of a scan over initial amplitudes and parameter values ends."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines
from hbbogie.results.netcdf import read, write
from hbbogie.results.pictures import draw, page
from hbbogie.units import behind, readable

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
OUTCOMES = ("rest", "cycle", "undecided")


@dataclass(frozen=True, eq=False, kw_only=True)
class Basin:
    """How motions from many initial states end, over the values of a parameter.

    Attributes
    ----------
    system : str
    parameter, parameter_unit : str
    values : ndarray, shape (values,), unit of the parameter
    coordinate, unit : str
        The coordinate in which amplitudes are given, and its unit.
    factors : ndarray, shape (factors,)
        By which the direction was multiplied: dimensionless along the unstable cycle, else the initial value of
        the direction's first coordinate in its unit.
    amplitudes : ndarray, shape (values, factors), unit of the coordinate
        Initial amplitude: along the unstable cycle the factor times that cycle's peak, else the initial value.
    direction : str
        What the factors multiply, a phrase.
    outcome : ndarray of str, shape (values, factors)
        "rest", "cycle" or "undecided".
    time : ndarray, shape (values, factors), s
        After which it was decided, or given up.
    reached : ndarray, shape (values, factors), unit of the coordinate
        Peak of the stable cycle a motion settles on; 0 at rest, NaN where undecided.
    reason : ndarray of str, shape (values, factors)
        How it was decided, or why it was not.
    unstable : ndarray, shape (values,), unit of the coordinate
        Peak of the smallest unstable cycle; NaN where there is none.
    stable : ndarray, shape (values,), unit of the coordinate
        Peak of the largest stable cycle; NaN where there is none.
    parameters : dict
        The other parameters' values.
    notes : tuple of str
        What could not be computed and why.
    attractor : ndarray of str, shape (values, factors), or None
        What moves on the cycle that is reached, such as "front bogie"; "" elsewhere. None where the coordinates belong
        to no groups of bodies.
    """

    system: str
    parameter: str
    parameter_unit: str
    values: Array
    coordinate: str
    unit: str
    factors: Array
    amplitudes: Array
    direction: str
    outcome: NDArray[np.str_]
    time: Array
    reached: Array
    reason: NDArray[np.str_]
    unstable: Array
    stable: Array
    parameters: dict[str, float]
    notes: tuple[str, ...] = ()
    attractor: NDArray[np.str_] | None = None

    @property
    def ends(self) -> NDArray[np.str_]:
        """How each motion ends, told apart by attractor where that is known, shape (values, factors)."""
        if self.attractor is None:
            return self.outcome
        return np.where(self.attractor == "", self.outcome, self.attractor)

    @property
    def kinds(self) -> list[str]:
        """Every way to end, rest first, then the attractors, undecided last."""
        met = [str(end) for end in np.unique(self.ends) if end not in OUTCOMES]
        return ["rest", *sorted(met, key=lambda kind: (kind in ("both", "all"), kind)), *OUTCOMES[1:]]

    def __repr__(self) -> str:
        ends = self.ends
        shown = [k for k in self.kinds if k != "cycle" or self.attractor is None or (ends == k).any()]
        counts = ", ".join(f"{int((ends == k).sum())} {k}" for k in shown)
        low, high = float(self.amplitudes.min()), float(self.amplitudes.max())
        factor, unit = readable(self.unit, max(abs(low), abs(high)))
        values = (
            f"{self.parameter} from {self.values.min():.6g} to {self.values.max():.6g}{behind(self.parameter_unit)}"
        )
        return lines(
            f"Basin of {self.system}: {self.outcome.size} motions, {values}",
            counts,
            f"initial amplitude of {self.coordinate} {factor * low:.4g} to {factor * high:.4g}{behind(unit)}",
            f"factors multiply {self.direction}",
            *self.notes[:2],
        )

    def _repr_html_(self) -> str:
        return page(repr(self), (), "basin", self)

    def plot(self, **options: Any) -> Any:
        """Draw the map; options and the axes returned as of `hbbogie.plot.basin`."""
        return draw("basin", self, **options)

    def count(self, outcome: str) -> NDArray[np.int_]:
        """Return how many motions end so at each value of the parameter, shape (values,)."""
        return np.asarray((self.outcome == outcome).sum(axis=1))

    def to_dataset(self) -> xr.Dataset:
        """Return the scan as a labelled dataset with units."""
        import xarray as xr

        grid, unit = (self.parameter, "factor"), {"units": self.unit}
        data: dict[str, Any] = {
            "outcome": (grid, self.outcome.astype(str), {"long_name": "how the motion ends"}),
            "amplitude": (grid, self.amplitudes, unit | {"long_name": f"initial amplitude of {self.coordinate}"}),
            "time": (grid, self.time, {"units": "s", "long_name": "time until decided or given up"}),
            "reached": (grid, self.reached, unit | {"long_name": f"peak of {self.coordinate} in the end"}),
            "reason": (grid, self.reason.astype(str)),
            "unstable": (self.parameter, self.unstable, unit | {"long_name": "peak of the smallest unstable cycle"}),
            "stable": (self.parameter, self.stable, unit | {"long_name": "peak of the largest stable cycle"}),
        }
        if self.attractor is not None:
            data["attractor"] = (grid, self.attractor.astype(str), {"long_name": "what moves on the cycle"})
        labels: dict[str, Any] = {
            self.parameter: (self.parameter, self.values, {"units": self.parameter_unit}),
            "factor": ("factor", self.factors, {"long_name": self.direction}),
        }
        attributes = {
            "system": self.system,
            "parameter": self.parameter,
            "coordinate": self.coordinate,
            "direction": self.direction,
            "parameters": json.dumps(self.parameters),
            "notes": json.dumps(self.notes),
        }
        return xr.Dataset(data, labels, attributes)

    @staticmethod
    def from_dataset(data: xr.Dataset) -> Basin:
        """Return the scan kept in a dataset made by `to_dataset`."""
        about, name = data.attrs, str(data.attrs["parameter"])
        get = {key: data[key].values for key in (*data.data_vars, name, "factor")}
        units = [str(data[key].attrs["units"]) for key in (name, "amplitude")]
        return Basin(
            system=str(about["system"]),
            parameter=name,
            parameter_unit=units[0],
            values=get[name],
            coordinate=str(about["coordinate"]),
            unit=units[1],
            factors=get["factor"],
            amplitudes=get["amplitude"],
            direction=str(about["direction"]),
            outcome=get["outcome"].astype(str),
            time=get["time"],
            reached=get["reached"],
            reason=get["reason"].astype(str),
            unstable=get["unstable"],
            stable=get["stable"],
            parameters=json.loads(about["parameters"]),
            notes=tuple(json.loads(about["notes"])),
            attractor=get["attractor"].astype(str) if "attractor" in get else None,
        )

    def save(self, path: str | Path) -> None:
        """Write the scan to a NetCDF file."""
        write(self.to_dataset(), path)

    @staticmethod
    def load(path: str | Path) -> Basin:
        """Read a scan from a NetCDF file written by `save`.

        Raises
        ------
        ModelError
            When the file is not there or was not written by `save`.
        """
        return read(path, Basin.from_dataset)
