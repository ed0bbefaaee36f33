"""The result of a study as a labelled dataset, and that dataset as NetCDF, CSV or Parquet."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie.errors import ModelError, as_path, of_kind
from hbbogie.model.system import System
from hbbogie.studies.jobs import output_units
from hbbogie.studies.optional import required
from hbbogie.studies.store import Store
from hbbogie.studies.store_file import is_store
from hbbogie.studies.store_rows import NOMINAL

if TYPE_CHECKING:
    import xarray as xr

FORMATS = (".nc", ".csv", ".parquet")
HDF5_ROOM = 4096  # bytes that a variable of a NetCDF file may need besides its data
OWN = ("status", "failed", "seconds", "worker", "finished")  # what every study has besides its outputs


def describe_units(store: Store, system: System, function: Callable[..., Any]) -> None:
    """Write the units of inputs and outputs into a store, which then needs neither problem nor job to be read."""
    about = store.about()
    names = list(dict.fromkeys(name for o, _, _ in store.outcomes() for name in o.outputs))
    parameter = str(about["options"].get("parameter", "V"))
    inputs = {
        n: (system.parameter(n).unit, system.parameter(n).description, system.values[n]) for n in about["parameters"]
    }
    store.describe({"inputs": inputs, "units": output_units(function, system, parameter, names)})


def dataset_of(store: Store) -> xr.Dataset:
    """Return the finished points of a study, labelled."""
    import xarray as xr

    about, everything, counts = store.about(), store.outcomes(), store.counts()
    nominal = next((o.outputs for o, _, _ in everything if o.point == NOMINAL), {})
    rows = [row for row in everything if row[0].point != NOMINAL]
    names = list(dict.fromkeys(name for o, _, _ in rows for name in o.outputs))
    units = about.get("units", {})
    data: dict[str, Any] = {}
    for name in names:
        column = _column([o.outputs.get(name) for o, _, _ in rows])
        data[name] = ("point", column, {"units": units.get(name, "")})
    data["status"] = ("point", _text([o.status for o, _, _ in rows]))
    data["failed"] = ("point", np.array([o.failed for o, _, _ in rows], dtype=bool))
    data["seconds"] = ("point", np.array([o.seconds for o, _, _ in rows], dtype=float), {"units": "s"})
    data["worker"] = ("point", _text([o.worker for o, _, _ in rows]))
    data["finished"] = ("point", _text([t for _, _, t in rows]), {"long_name": "time of finishing, UTC"})
    labels: dict[str, Any] = {"point": np.array([o.point for o, _, _ in rows], dtype=int)}
    for name in about["parameters"]:
        unit, description, _ = about["inputs"][name]
        column = np.array([i[name] for _, i, _ in rows], dtype=float)
        labels[name] = ("point", column, {"units": unit, "long_name": description})
    attributes = {
        "inputs": json.dumps(about["parameters"]),
        "outputs": json.dumps(names),
        "sampling": about["sampling"],
        "seed": "" if about["seed"] is None else about["seed"],
        "drawn": json.dumps(about.get("drawn", {})),
        "total": counts.total,
        "damaged": json.dumps(counts.damaged),
        "problem": about["problem"],
        "problem_hash": about["fingerprints"]["problem"],
        "job": about["job"],
        "job_hash": about["fingerprints"]["job"],
        **{name: json.dumps(about[name]) for name in ("options", "values", "versions")},
        "changes": json.dumps(about.get("changes", [])),
        "nominal_inputs": json.dumps({n: about["inputs"][n][2] for n in about["parameters"]}),
        "nominal_outputs": json.dumps(nominal),
    }
    return xr.Dataset(data, labels, attributes)


def _column(values: list[Any]) -> np.ndarray[Any, Any]:
    """Return numbers, NaN where there is none, or text, empty where there is none."""
    if any(isinstance(v, str) for v in values):
        return _text(["" if v is None else str(v) for v in values])
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def _text(values: list[str]) -> np.ndarray[Any, Any]:
    return np.array(values, dtype=str)


def names_of(data: xr.Dataset, what: str) -> list[str]:
    """Return the names of the "inputs" or "outputs" of a study."""
    return list(json.loads(data.attrs[what]))


def check_export(path: str | Path) -> Path:
    """Return the path of an export; raise `ModelError` where its ending or directory is wrong, or it is a store."""
    target = as_path("file to export to", path)
    if target.suffix not in FORMATS:
        raise ModelError(f"cannot export to {str(target)!r}: give a name that ends in {', '.join(FORMATS)}.")
    if not target.parent.is_dir():
        raise ModelError(f"cannot write {str(target)!r}: the directory {str(target.parent)!r} does not exist; make it.")
    if is_store(target):
        raise ModelError(f"{str(target)!r} is the store of a study, which an export would replace; give another name.")
    return target


def export(data: xr.Dataset, path: str | Path) -> Path:
    """Write the result of a study as NetCDF (.nc), CSV (.csv) or Parquet (.parquet).

    Parameters
    ----------
    data : xarray.Dataset
        As returned by `sweep`.
    path : str or path

    Raises
    ------
    ModelError
        For another ending, a directory that does not exist, Parquet without pyarrow, or a file that cannot be written.
    """
    import xarray as xr

    of_kind("export", data, xr.Dataset)
    target = check_export(path)
    with replacing(target) as part:
        _write(data, part, target.suffix)
    return target


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Give the name of a file to be written, which then takes the place of another; a failure leaves that as it was.

    Raises
    ------
    ModelError
        When it cannot be written.
    """
    part = target.with_name(f"{target.name}.part")
    try:
        yield part
        part.replace(target)
    except (OSError, RuntimeError) as error:  # of HDF5 the latter
        raise ModelError(f"cannot write {str(target)!r}: {error}; make room, or give another place.") from error
    finally:
        part.unlink(missing_ok=True)


def _write(data: xr.Dataset, target: Path, ending: str) -> None:
    """Write a dataset in the format that an ending says."""
    if ending == ".nc":
        target.write_bytes(
            bytes(HDF5_ROOM + 2 * data.nbytes)
        )  # HDF5 crashes where the disk is full: see that it is not
        data.to_netcdf(target, engine="h5netcdf")
        return
    columns = {"point": data["point"].values}
    columns |= {n: data[n].values for n in (*names_of(data, "inputs"), *names_of(data, "outputs"), *OWN)}
    headers = {n: f"{n} [{data[n].attrs['units']}]" if data[n].attrs.get("units") else n for n in columns}
    if ending == ".csv":
        with open(target, "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(headers.values())
            for row in zip(*(c.tolist() for c in columns.values()), strict=True):
                writer.writerow(["" if isinstance(v, float) and v != v else v for v in row])
        return
    arrow, parquet = required("pyarrow"), required("pyarrow.parquet")
    fields = [
        arrow.field(n, arrow.array(c).type, metadata={"unit": data[n].attrs.get("units", "")})
        for n, c in columns.items()
    ]
    about = {name: str(value) for name, value in data.attrs.items()}
    parquet.write_table(arrow.table(list(map(arrow.array, columns.values())), arrow.schema(fields, about)), target)
