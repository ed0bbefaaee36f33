"""The rows of a study's store: their layout, their checksums, and what is written first."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from hbbogie.errors import ModelError
from hbbogie.studies.fingerprints import digest
from hbbogie.studies.sampling import Points

VERSION = 2  # of the layout below
NOMINAL = -1  # number of the point at the system's own values
COLUMNS = "point, inputs, outputs, status, failed, seconds, worker, finished"
LAYOUT = f"""
PRAGMA user_version = {VERSION};
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL, checksum TEXT) WITHOUT ROWID;
CREATE TABLE about_again (name TEXT PRIMARY KEY, value TEXT NOT NULL, checksum TEXT) WITHOUT ROWID;
CREATE TABLE points (
    point INTEGER PRIMARY KEY,  -- -1 is the nominal point
    inputs TEXT NOT NULL,       -- JSON: parameter values by name
    outputs TEXT,               -- JSON: NULL as long as the point is missing
    status TEXT, failed INTEGER, seconds REAL, worker TEXT, finished TEXT, checksum TEXT
);
"""
ABOUT = ("about", "about_again")  # two copies, since without it nothing can be read
SQL_ROW = f"INSERT OR REPLACE INTO points ({COLUMNS}, checksum) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
DAMAGED = "the row is damaged: what the file holds of it is not what was written"

Row = tuple[Any, ...]  # the columns of a point, in their order


class About(dict[str, Any]):
    """What a study is about, by name; what is not there, or damaged in both copies, is missed in a sentence."""

    def __missing__(self, name: str) -> Any:
        raise ModelError(f"the store of the study does not say its {name!r}: it is damaged, or was made without it.")


def points_described(points: Points) -> dict[str, Any]:
    """Return what a store says about its points."""
    return {
        "parameters": list(points.names),
        "sampling": points.kind,
        "seed": points.seed,
        "total": len(points),
        "drawn": dict(points.drawn),
    }


def checksum_of(values: Row) -> str:
    """Return the checksum of the values of a row, which include its number or name."""
    return digest(repr(tuple(values)))


def whole_rows(found: list[Row]) -> list[Row]:
    """Return the rows whose checksum is right, without it."""
    return [row[:-1] for row in found if row[-1] == checksum_of(row[:-1])]


def write_rows(connection: sqlite3.Connection, rows: Iterable[Row]) -> None:
    """Write the rows of points, with their checksums."""
    connection.executemany(SQL_ROW, ((*row, checksum_of(row)) for row in rows))


def write_about(connection: sqlite3.Connection, about: Mapping[str, Any]) -> None:
    """Write what the study is about, twice."""
    rows = [(name, json.dumps(value, default=str)) for name, value in about.items()]
    for table in ABOUT:
        connection.executemany(
            f"INSERT OR REPLACE INTO {table} VALUES (?, ?, ?)", [(*row, checksum_of(row)) for row in rows]
        )


def empty_rows(points: Points) -> Iterator[Row]:
    """Yield the rows of points that are not finished, the nominal one first."""
    for i in range(NOMINAL, len(points)):
        yield (i, "{}" if i == NOMINAL else json.dumps(points.point(i)), *[None] * 6)


def fill(connection: sqlite3.Connection, points: Points, about: Mapping[str, Any]) -> None:
    """Write layout, points and description of a new study."""
    connection.executescript(LAYOUT)
    write_rows(connection, empty_rows(points))
    write_about(connection, about)
    connection.commit()


def listed(points: Sequence[int], most: int = 10) -> str:
    """Return the numbers of points as text, the nominal one by its name; of many the first ones."""
    names = ["nominal" if i == NOMINAL else str(i) for i in points[:most]]
    return ", ".join(names) + (f" and {len(points) - most} more" if len(points) > most else "")
