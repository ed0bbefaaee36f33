"""Branches of cycles and their special points."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import lines
from hbbogie.results.ending import Ending
from hbbogie.results.measuring import resting
from hbbogie.results.netcdf import read, write
from hbbogie.results.orbit import NOT_RESOLVED, Orbit, unpack
from hbbogie.results.pictures import draw, page
from hbbogie.results.stored import labels_of, pack
from hbbogie.units import behind, readable

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]
MARKS = 6  # special points shown at most
# names of a dataset beside its variables
TAKEN = {"coordinate", "parameter", "output", "point", "sample", "special", "onward", "row"}


@dataclass(frozen=True, eq=False)
class SpecialPoint:
    """A point of a branch, or of a family of equilibria, where something changes.

    Attributes
    ----------
    kind : str
        "hopf", "fold", "branch point", "pitchfork" (the symmetry breaks), "period doubling", "Neimark-Sacker",
        "grazing" (a contact begins or ceases to close), or "not located" (the stability changes, unexplained).
    parameter : str
        Name of the parameter.
    value : float, unit of the parameter
    interval : (float, float)
        The located point lies between these values of the parameter (for a fold: they enclose the extremum's
        remaining error).
    orbit : Orbit
        The cycle at the point; at a Hopf point the small linear cycle along the critical mode, scaled
        to a largest coordinate of 1 in its unit.
    status : str
        What happens and how well it is located, a sentence.
    onward : Orbit or None
        At a branch point, pitchfork or period doubling: a first guess of a cycle on the branch that begins here.
    criticality : {"subcritical", "supercritical", ""}
        Of a Hopf point from which a branch was traced: whether cycles begin beside the stable or the unstable
        equilibrium.
    extremum : {"minimum", "maximum", ""}
        Of a fold: of the parameter along the branch.
    """

    kind: str
    parameter: str
    value: float
    interval: tuple[float, float]
    orbit: Orbit
    status: str
    onward: Orbit | None = None
    criticality: str = ""
    extremum: str = ""

    @property
    def resolved(self) -> bool:
        """Whether nothing speaks against the point: of a fold multipliers, or, if they do not tell, more harmonics."""
        return NOT_RESOLVED not in self.status

    @property
    def omega(self) -> float:
        """Frequency at the point [rad/s]."""
        return self.orbit.omega

    @property
    def headline(self) -> str:
        """What it is and where, such as "fold at V = 88.7641 m/s, minimum"."""
        kind = {"hopf": "Hopf point", "": "point"}.get(self.kind, self.kind)
        place = f"{kind} at {self.orbit.naming.value(self.parameter, self.value, 8)}"
        return ", ".join(
            filter(None, [place, self.criticality or self.extremum, "" if self.resolved else NOT_RESOLVED])
        )

    def __repr__(self) -> str:
        low, high = self.interval
        return lines(
            f"{self.orbit.system}: {self.headline}",
            f"between {low:.12g} and {high:.12g}, omega {self.omega:.8g} rad/s",
            self.status,
            "another branch begins here: trace from this point" if self.onward is not None else "",
        )

    def _repr_html_(self) -> str:
        return page(repr(self))


@dataclass(frozen=True, eq=False)
class Branch:
    """A curve of cycles over a parameter, in the order of its arclength.

    Attributes
    ----------
    orbits : tuple of Orbit
    parameter : str
        Name of the continuation parameter.
    special : tuple of SpecialPoint
        Special points, in the order met.
    ends : (Ending, Ending)
        Why the branch ends where it begins and where it ends.
    """

    orbits: tuple[Orbit, ...]
    parameter: str
    special: tuple[SpecialPoint, ...] = ()
    ends: tuple[Ending, Ending] = (Ending(), Ending())

    def __len__(self) -> int:
        return len(self.orbits)

    def __iter__(self) -> Iterator[Orbit]:
        return iter(self.orbits)

    @overload
    def __getitem__(self, i: int) -> Orbit: ...

    @overload
    def __getitem__(self, i: slice) -> Branch: ...

    def __getitem__(self, i: int | slice) -> Orbit | Branch:
        """Return a point, or the branch of some of them, with the special points beside these."""
        return self._part(self.orbits[i]) if isinstance(i, slice) else self.orbits[i]

    def between(self, low: float, high: float) -> tuple[Branch, ...]:
        """Return the stretches of the branch on which the parameter lies between two values, both included.

        Parameters
        ----------
        low, high : float, unit of the parameter
        """
        inside = [low <= value <= high for value in self.values]
        runs = groupby(range(len(self)), key=lambda i: inside[i])
        return tuple(self._part([self.orbits[i] for i in run]) for within, run in runs if within)

    def place(self, special: SpecialPoint) -> int:
        """Return the place of the point of the branch that is nearest to a special point."""
        away = np.zeros(len(self))
        for own, at in self._sizes(special):
            away += ((own - at) / max(float(np.ptp(own)), 1e-12 * abs(at), 1e-300)) ** 2
        return int(np.argmin(away))

    def _sizes(self, special: SpecialPoint) -> Iterator[tuple[Array, float]]:
        """Give parameter, frequency and first harmonics of all points with those of a special point."""
        yield self.values, special.value
        yield self.omega, special.omega
        if special.kind != "hopf":  # whose orbit shows the mode, not an amplitude
            for c in self.orbits[0].coordinates:
                yield self.first_harmonic(c), special.orbit.first_harmonic(c)

    def _part(self, orbits: Sequence[Orbit]) -> Branch:
        kept = {id(o) for o in orbits}
        near = [s for s in self.special if id(self.orbits[self.place(s)]) in kept]
        cut = Ending("shown", "cut here")
        first = self.ends[0] if orbits and orbits[0] is self.orbits[0] else cut
        last = self.ends[1] if orbits and orbits[-1] is self.orbits[-1] else cut
        return Branch(tuple(orbits), self.parameter, tuple(near), (first, last))

    @property
    def unit(self) -> str:
        """Unit of the parameter; empty where it is not known."""
        return self.orbits[0].naming.units.get(self.parameter, "")

    @property
    def label(self) -> str:
        """Label of the parameter for an axis, such as "speed V [m/s]"."""
        return self.orbits[0].naming.label(self.parameter)

    @property
    def values(self) -> Array:
        """Parameter value of each point, shape (points,) [unit of the parameter]."""
        return np.array([o.parameters[self.parameter] for o in self.orbits])

    @property
    def omega(self) -> Array:
        """Frequency of each point, shape (points,) [rad/s]."""
        return np.array([o.omega for o in self.orbits])

    def amplitude(self, coordinate: str) -> Array:
        """Return the peak of a coordinate at each point, shape (points,) [its unit]."""
        return np.array([o.amplitude(coordinate) for o in self.orbits])

    def first_harmonic(self, coordinate: str) -> Array:
        """Return the first-harmonic amplitude of a coordinate at each point, shape (points,) [its unit]."""
        return np.array([o.first_harmonic(coordinate) for o in self.orbits])

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Stability verdict of each point ("unknown" where it was not computed)."""
        return tuple(o.stability.verdict if o.stability else "unknown" for o in self.orbits)

    @property
    def unfinished(self) -> str:
        """Why it was not followed to its ends; empty where it was."""
        return "; ".join(str(end) for end in self.ends if not end.complete)

    def folds(self) -> tuple[SpecialPoint, ...]:
        """Return the folds."""
        return tuple(s for s in self.special if s.kind == "fold")

    def with_orbits(self, orbits: Sequence[Orbit]) -> Branch:
        """Return the branch with the same points in another dress, such as with stability."""
        return replace(self, orbits=tuple(orbits))

    def to_dataset(self) -> xr.Dataset:
        """Return the branch as a labelled dataset; `from_dataset` is its inverse."""
        import xarray as xr

        data, unit = pack(self.orbits, "point"), {"units": self.unit or "1"}
        if self.special:
            data |= pack(
                [resting(s.orbit) if s.kind == "hopf" else s.orbit for s in self.special], "special", prefix="special_"
            )
            data["special_kind"] = ("special", np.array([s.kind for s in self.special], dtype=str))
            data["special_status"] = ("special", np.array([s.status for s in self.special], dtype=str))
            data["special_criticality"] = ("special", np.array([s.criticality for s in self.special], dtype=str))
            data["special_extremum"] = ("special", np.array([s.extremum for s in self.special], dtype=str))
            data["special_value"] = ("special", [s.value for s in self.special], unit)
            data["special_interval"] = (("special", "bound"), [s.interval for s in self.special], unit)
        beginning = [i for i, s in enumerate(self.special) if s.onward is not None]
        if beginning:
            data |= pack([s.onward for s in self.special if s.onward is not None], "onward", prefix="onward_")
            data["onward_of"] = ("onward", beginning)
        own = self.parameter if self.parameter not in TAKEN | set(data) else f"{self.parameter}_value"
        along = {} if len(self.parameter) == 0 else {own: ("point", self.values, unit | {"long_name": self.label})}
        ends = json.dumps([astuple(end) for end in self.ends])
        about = {"system": self.orbits[0].system, "continuation_parameter": self.parameter, "ends": ends}
        return xr.Dataset(data, labels_of(self.orbits[0]) | along, about)

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table of the points, a row each, with the parameter as index.

        Its columns are frequency, period, peak and first harmonic of every coordinate, peak and rms of every output,
        verdict, modulus of the largest multiplier, highest harmonic, residual and method. ``attrs["units"]`` holds the
        unit of each by its name.
        """
        import pandas as pd

        first = self.orbits[0]
        columns: dict[str, tuple[str, Any]] = {
            "omega": ("rad/s", self.omega),
            "period": ("s", [o.period for o in self.orbits]),
        }
        for c, unit in zip(first.coordinates, first.units, strict=True):
            columns[f"peak {c}"] = unit or "1", self.amplitude(c)
            columns[f"first harmonic {c}"] = unit or "1", self.first_harmonic(c)
        for name in first.outputs:
            unit = first.naming.units.get(name, "1")
            columns[f"peak {name}"] = unit, self.amplitude(name)
            columns[f"rms {name}"] = unit, [o.rms(name) for o in self.orbits]
        columns["stability"] = "", list(self.verdicts)
        columns["largest multiplier"] = "1", [o.largest_multiplier for o in self.orbits]
        columns["highest harmonic"] = "1", [o.kept for o in self.orbits]
        columns["residual"] = "1", [o.residual for o in self.orbits]
        columns["method"] = "", [o.method for o in self.orbits]
        index = pd.Index(self.values, name=self.parameter)
        table = pd.DataFrame({name: values for name, (_, values) in columns.items()}, index=index)
        table["largest multiplier"] = table["largest multiplier"].astype(float)
        table.attrs["units"] = {self.parameter: self.unit or "1"} | {n: u for n, (u, _) in columns.items() if u}
        return table

    def plot(self, y: str | None = None, **options: Any) -> Any:
        """Draw the branch over its parameter; options and the axes returned as of `hbbogie.plot.branch`."""
        return draw("branch", self, y=y, **options)

    def __repr__(self) -> str:
        if not self.orbits:
            return f"Branch over {self.parameter}: no points"
        first, verdicts = self.orbits[0], self.verdicts
        low, high = float(self.values.min()), float(self.values.max())
        counts = ", ".join(f"{verdicts.count(v)} {v}" for v in ("stable", "unstable", "unknown") if v in verdicts)
        what = "equilibria" if all(o.H == 0 for o in self.orbits) else "cycles"
        marks = "; ".join(s.headline for s in self.special[:MARKS])
        c, peaks = first.coordinates[0], self.amplitude(first.coordinates[0])
        factor, unit = readable(first.units[0], float(peaks.max()))
        peak = f"peak {c} {factor * peaks.min():.4g} to {factor * peaks.max():.4g}{behind(unit)}"
        return lines(
            f"Branch of {first.system}: {len(self)} {what}, {first.naming.value(self.parameter, low)} to {high:.6g}",
            counts,
            f"{peak}, omega {self.omega.min():.6g} to {self.omega.max():.6g} rad/s",
            f"{len(self.special)} special point{'s' * (len(self.special) != 1)}: {marks}" if marks else "",
            f"begins: {self.ends[0]}" if str(self.ends[0]) else "",
            f"ends: {self.ends[1]}" if str(self.ends[1]) else "",
        )

    def _repr_html_(self) -> str:
        rows = [("special point", self.label), *((s.kind, f"{s.value:.8g}") for s in self.special[:MARKS])]
        return page(repr(self), rows if self.special else (), "branch", self)

    @staticmethod
    def from_dataset(data: xr.Dataset) -> Branch:
        """Return the branch kept in a dataset made by `to_dataset`."""
        parameter = str(data.attrs["continuation_parameter"])
        special: list[SpecialPoint] = []
        onward = {}
        if "onward_of" in data:
            onward = dict(zip(map(int, data["onward_of"].values), unpack(data, prefix="onward_"), strict=True))
        if "special_kind" in data:
            for i, orbit in enumerate(unpack(data, prefix="special_")):
                special.append(
                    SpecialPoint(
                        str(data["special_kind"].values[i]),
                        parameter,
                        float(data["special_value"].values[i]),
                        tuple(float(b) for b in data["special_interval"].values[i]),  # type: ignore[arg-type]
                        orbit,
                        str(data["special_status"].values[i]),
                        onward.get(i),
                        str(data["special_criticality"].values[i]),
                        str(data["special_extremum"].values[i]) if "special_extremum" in data else "",
                    )
                )
        # files of version 0.1 hold the sentences only
        saved = json.loads(data.attrs["ends"])
        first, last = (Ending(what=end) if isinstance(end, str) else Ending(*end) for end in saved)
        return Branch(tuple(unpack(data)), parameter, tuple(special), (first, last))

    def save(self, path: str | Path) -> None:
        """Write the branch to a NetCDF file."""
        write(self.to_dataset(), path)

    @staticmethod
    def load(path: str | Path) -> Branch:
        """Read a branch from a NetCDF file written by `save`.

        Raises
        ------
        ModelError
            When the file is not there or was not written by `save`.
        """
        return read(path, Branch.from_dataset)
