"""Branches of cycles and their special points."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hbbogie.results.ending import Ending
from hbbogie.results.netcdf import read, write
from hbbogie.results.orbit import NOT_RESOLVED, Orbit, labels_of, pack, unpack

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


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
        """Whether nothing speaks against the point: of a fold, that the multipliers of its cycle meet at 1."""
        return NOT_RESOLVED not in self.status

    @property
    def omega(self) -> float:
        """Frequency at the point [rad/s]."""
        return self.orbit.omega


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

    def folds(self) -> tuple[SpecialPoint, ...]:
        """Return the folds."""
        return tuple(s for s in self.special if s.kind == "fold")

    def with_orbits(self, orbits: Sequence[Orbit]) -> Branch:
        """Return the branch with the same points in another dress, such as with stability."""
        return replace(self, orbits=tuple(orbits))

    def to_dataset(self) -> xr.Dataset:
        """Return the branch as a labelled dataset; `from_dataset` is its inverse."""
        import xarray as xr

        data, attributes = pack(self.orbits, "point")
        if self.special:
            extra, _ = pack([s.orbit for s in self.special], "special", prefix="special_")
            data |= extra
            data["special_kind"] = ("special", np.array([s.kind for s in self.special], dtype=str))
            data["special_status"] = ("special", np.array([s.status for s in self.special], dtype=str))
            data["special_criticality"] = ("special", np.array([s.criticality for s in self.special], dtype=str))
            data["special_extremum"] = ("special", np.array([s.extremum for s in self.special], dtype=str))
            data["special_value"] = ("special", [s.value for s in self.special])
            data["special_interval"] = (("special", "bound"), [s.interval for s in self.special])
        beginning = [i for i, s in enumerate(self.special) if s.onward is not None]
        if beginning:
            extra, _ = pack([s.onward for s in self.special if s.onward is not None], "onward", prefix="onward_")
            data |= extra
            data["onward_of"] = ("onward", beginning)
        return xr.Dataset(
            data,
            coords=labels_of(self.orbits[0]),
            attrs=attributes
            | {"continuation_parameter": self.parameter, "ends": json.dumps([astuple(end) for end in self.ends])},
        )

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
