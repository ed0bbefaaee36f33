"""Results in NetCDF files: the layout of orbits in a labelled dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, as_path

if TYPE_CHECKING:
    import xarray as xr

T = TypeVar("T")


def _pack_complex(
    name: str, rows: Sequence[NDArray[np.complex128] | None], dimensions: tuple[str, ...]
) -> dict[str, Any]:
    """Return the two variables of one complex vector per orbit, padded with NaN; none when all are None."""
    count = max((len(r) for r in rows if r is not None), default=0)
    values = np.full((len(rows), count), complex(np.nan, np.nan))
    for i, row in enumerate(rows):
        if row is not None:
            values[i, : len(row)] = row
    values = values[:, 0] if len(dimensions) == 1 and count else values
    parts = {f"{name}_real": (dimensions, values.real), f"{name}_imaginary": (dimensions, values.imag)}
    return parts if count else {}


def _unpack_complex(data: xr.Dataset, name: str, i: int) -> NDArray[np.complex128] | None:
    """Return what `_pack_complex` put into a dataset for orbit i; None where there was nothing."""
    if name + "_real" not in data:
        return None
    parts = [np.atleast_1d(data[f"{name}_{part}"].values[i]) for part in ("real", "imaginary")]
    values = parts[0] + 1j * parts[1]
    values = values[~np.isnan(values)]
    return values if len(values) else None


def write(data: xr.Dataset, path: str | Path) -> None:
    """Write a dataset to a NetCDF file; raise `ModelError` when its directory does not exist."""
    target = as_path("file to write", path)
    if not target.parent.is_dir():
        raise ModelError(f"cannot write {str(target)!r}: the directory {str(target.parent)!r} does not exist; make it.")
    try:
        data.to_netcdf(target, engine="h5netcdf")
    except OSError as error:
        reason = error.strerror or str(error)
        raise ModelError(f"cannot write {str(target)!r}: {reason}; give a file in a folder of yours.") from error


def read(path: str | Path, take: Callable[[xr.Dataset], T]) -> T:
    """Return what ``take`` makes of the dataset in a NetCDF file.

    Raises
    ------
    ModelError
        When the file is not there or does not hold what was looked for.
    """
    import xarray as xr

    file = as_path("file to read", path)
    if not file.is_file():
        raise ModelError(f"no file {str(path)!r}; give a NetCDF file written by this package.")
    try:
        with xr.open_dataset(file, engine="h5netcdf") as data:
            return take(data.load())
    except (KeyError, OSError, ValueError) as error:
        raise ModelError(f"{str(path)!r} does not hold what was saved by this package: {error}") from error
