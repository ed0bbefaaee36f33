"""The store of a study: one SQLite file that survives whatever happens to the process that writes it.

Every finished point is one transaction. In the write-ahead mode used here, a process that is killed leaves the file as
the last transaction left it. Only one process writes. It holds a lock that the operating system releases when the
process ends.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.studies.sampling import Points
from hbbogie.studies.tasks import Outcome

VERSION = "1"  # of the layout below
NOMINAL = -1  # number of the point at the system's own values
LEAST, EACH = 512 * 1024, 3000  # bytes reserved: at least, and for each point
LAYOUT = """
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE points (
    point INTEGER PRIMARY KEY,  -- -1 is the nominal point
    inputs TEXT NOT NULL,       -- JSON: parameter values by name
    outputs TEXT,               -- JSON: NULL as long as the point is missing
    status TEXT, failed INTEGER, seconds REAL, worker TEXT, finished TEXT
);
"""
SQL_INSERT = "INSERT OR REPLACE INTO points (point, inputs) VALUES (?, ?)"
SQL_ABOUT = "INSERT OR REPLACE INTO about VALUES (?, ?)"
SQL_PUT = """UPDATE points SET outputs = ?, status = ?, failed = ?, seconds = ?, worker = ?,
    finished = strftime('%Y-%m-%dT%H:%M:%fZ') WHERE point = ?"""


@dataclass(frozen=True)
class Counts:
    """How many points of a study there are, and how many are finished.

    Attributes
    ----------
    total, done, failed : int
        Points; the failed ones are among those done.
    seconds : float
        Time that the finished points took, over all workers.
    """

    total: int
    done: int
    failed: int
    seconds: float


class Store:
    """A study's file. Open it with `Store.create`, `Store.open` or `Store.read`, close it with ``close``."""

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: sqlite3.Connection | None):
        self.path, self._connection, self._lock = path, connection, lock

    # --- opening ------------------------------------------------------------------------------

    @classmethod
    def create(cls, path: str | Path | None, points: Points, about: Mapping[str, Any]) -> Store:
        """Make the file of a new study, with all its points, and hold its lock.

        Parameters
        ----------
        path : str, path or None
            None keeps the study in memory.
        points : Points
        about : mapping from name to anything JSON can hold

        Raises
        ------
        ModelError
            When the file exists, its directory cannot be written, or there is not enough room for the results.
        """
        target = Path(path or ":memory:")
        if path is not None and target.exists():
            raise ModelError(f"{str(target)!r} exists; resume it, or give another name.")
        content = {**about, "layout": VERSION, **_described(points)}
        if path is None:
            connection = sqlite3.connect(":memory:")
            _fill(connection, points, content)
            return cls(target, connection, None)
        lock, part = _lock(target), Path(f"{target}.part")
        try:
            _remove(part)
            with closing(sqlite3.connect(part)) as connection:
                _reserve(connection, max(LEAST, EACH * len(points)))
                _fill(connection, points, content)
            part.replace(target)  # whole or not at all, whenever the process is killed
            return cls(target, _connect(target), lock)
        except (sqlite3.Error, OSError) as error:
            _unlock(lock)
            _remove(part)
            raise _disk(target, error) from error

    @classmethod
    def open(cls, path: str | Path) -> Store:
        """Open an existing study to go on with it, and hold its lock.

        Raises
        ------
        ModelError
            When there is no such file, it is no study, it cannot be written, or another process works on it.
        """
        target = _existing(path)
        lock = _lock(target)
        try:
            store = cls(target, _connect(target), lock)
        except sqlite3.Error as error:
            _unlock(lock)
            raise _disk(target, error) from error
        try:
            store._check()
            _reserve(store._connection, max(LEAST, EACH * len(store.missing())))
            return store
        except sqlite3.Error as error:
            store.close()
            raise _disk(target, error) from error
        except ModelError:
            store.close()
            raise

    @classmethod
    def read(cls, path: str | Path) -> Store:
        """Open an existing study to look at it, also while another process works on it."""
        target = _existing(path)
        try:
            connection = sqlite3.connect(f"{target.resolve().as_uri()}?mode=ro", uri=True, timeout=10.0)
        except sqlite3.Error as error:
            raise _disk(target, error) from error
        store = cls(target, connection, None)
        try:
            store._check()
        except ModelError:
            store.close()
            raise
        return store

    def _check(self) -> None:
        try:
            layout = self.about().get("layout")
        except sqlite3.DatabaseError as error:
            raise ModelError(f"{str(self.path)!r} is not the store of a study: {error}.") from error
        if layout != VERSION:
            raise ModelError(f"{str(self.path)!r} has layout {layout}; this version of hbbogie reads layout {VERSION}.")

    def close(self) -> None:
        """Close the file and give its lock back."""
        if self._lock is not None:
            with suppress(sqlite3.Error):  # refused while somebody reads, and then the file stays as it is
                self._connection.execute("PRAGMA journal_mode = DELETE")  # one file, to be read anywhere
        self._connection.close()
        if self._lock is not None:
            _unlock(self._lock)
            self._lock = None

    # --- what it is about ---------------------------------------------------------------------

    def describe(self, about: Mapping[str, Any]) -> None:
        """Write down what the study is about, by name."""
        rows = [(name, json.dumps(value, default=str)) for name, value in about.items()]
        with self._connection as c:
            c.executemany(SQL_ABOUT, rows)

    def about(self) -> dict[str, Any]:
        """Return what was written down by `describe`."""
        return {n: json.loads(v) for n, v in self._connection.execute("SELECT name, value FROM about")}

    # --- points -------------------------------------------------------------------------------

    def put(self, outcome: Outcome) -> None:
        """Write a finished point, in a transaction of its own; raise `ModelError` when the disk refuses it."""
        o = outcome
        try:
            with self._connection as c:
                c.execute(SQL_PUT, (json.dumps(o.outputs), o.status, int(o.failed), o.seconds, o.worker, o.point))
        except sqlite3.Error as error:
            raise _disk(self.path, error) from error

    def missing(self) -> list[tuple[int, dict[str, float]]]:
        """Return number and parameter values of the points that are not finished, the nominal one first."""
        rows = self._connection.execute("SELECT point, inputs FROM points WHERE outputs IS NULL ORDER BY point")
        return [(point, json.loads(inputs)) for point, inputs in rows]

    def forget_failed(self) -> None:
        """Make the failed points missing ones, to be tried again."""
        with self._connection as c:
            c.execute("UPDATE points SET outputs = NULL, failed = NULL WHERE failed")

    def replace_points(self, points: Points) -> None:
        """Take other points; the outcome of a point with the same values as before is kept."""
        columns = "inputs, outputs, status, failed, seconds, worker, finished"
        with self._connection as c:
            query = f"SELECT {columns} FROM points WHERE outputs IS NOT NULL AND point >= 0"
            old = {row[0]: row[1:] for row in c.execute(query)}
            c.execute("DELETE FROM points")
            c.execute(SQL_INSERT, (NOMINAL, "{}"))
            inputs = [json.dumps(points.point(i)) for i in range(len(points))]
            rows = [(i, text, *old.get(text, (None,) * 6)) for i, text in enumerate(inputs)]
            c.executemany(f"INSERT INTO points (point, {columns}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
        self.describe(_described(points))

    def counts(self) -> Counts:
        """Return how many points there are, and how many are finished."""
        query = "SELECT count(*), count(outputs), total(failed), total(seconds) FROM points WHERE point >= 0"
        total, done, failed, seconds = self._connection.execute(query).fetchone()
        return Counts(total, done, int(failed), float(seconds))

    def outcomes(self) -> list[tuple[Outcome, dict[str, float], str]]:
        """Return the outcome, the parameter values and the time of finishing of every point that is finished."""
        query = "SELECT point, outputs, status, failed, seconds, worker, inputs, finished FROM points"
        rows = self._connection.execute(f"{query} WHERE outputs IS NOT NULL ORDER BY point")
        found = []
        for point, outputs, status, failed, seconds, worker, inputs, finished in rows:
            time = float("nan") if seconds is None else seconds
            found.append(
                (Outcome(point, json.loads(outputs), status, bool(failed), time, worker), json.loads(inputs), finished)
            )
        return found

    def points(self) -> Points:
        """Return all points of the study, finished or not."""
        rows = self._connection.execute("SELECT inputs FROM points WHERE point >= 0 ORDER BY point").fetchall()
        about = self.about()
        values = np.array([list(json.loads(text).values()) for (text,) in rows])
        return Points(tuple(about["parameters"]), values, about["sampling"], about["seed"])


def is_store(path: str | Path) -> bool:
    """Tell by its first bytes whether a file is a database."""
    try:
        with open(path, "rb") as file:
            return file.read(16) == b"SQLite format 3\0"
    except OSError:
        return False


def _described(points: Points) -> dict[str, Any]:
    return {"parameters": list(points.names), "sampling": points.kind, "seed": points.seed}


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=10.0)
    connection.execute("PRAGMA journal_mode = WAL")
    # in write-ahead mode this is safe against the death of the process, and writes to disk at checkpoints
    connection.execute("PRAGMA synchronous = NORMAL")
    return connection


def _existing(path: str | Path) -> Path:
    if not Path(path).is_file():
        raise ModelError(f"no study {str(path)!r}; give the path of a store written before.")
    return Path(path)


def _fill(connection: sqlite3.Connection, points: Points, about: Mapping[str, Any]) -> None:
    """Write layout, points and description of a new study."""
    connection.executescript(LAYOUT)
    connection.execute(SQL_INSERT, (NOMINAL, "{}"))
    connection.executemany(SQL_INSERT, [(i, json.dumps(points.point(i))) for i in range(len(points))])
    connection.executemany(SQL_ABOUT, [(name, json.dumps(value, default=str)) for name, value in about.items()])
    connection.commit()


def _reserve(connection: sqlite3.Connection, size: int) -> None:
    """Claim room in the file: what is deleted again stays in it as free pages."""
    connection.execute("CREATE TABLE IF NOT EXISTS reserve (room BLOB)")
    connection.execute("INSERT INTO reserve VALUES (zeroblob(?))", (size,))
    connection.commit()
    connection.execute("DROP TABLE reserve")
    connection.commit()


def _remove(part: Path) -> None:
    """Remove what is there of a store that was not finished, and its journal."""
    for path in (part, Path(f"{part}-journal")):
        path.unlink(missing_ok=True)


def _lock(path: Path) -> sqlite3.Connection:
    """Return the connection that holds a study's lock, a file beside it locked by SQLite, on every platform alike."""
    try:
        lock = sqlite3.connect(f"{path}.lock", timeout=0.0, isolation_level=None)
    except sqlite3.OperationalError as error:
        raise _disk(path, error) from error
    try:
        lock.execute("PRAGMA journal_mode = MEMORY")
        lock.execute("BEGIN EXCLUSIVE")
        lock.execute("CREATE TABLE IF NOT EXISTS held (by TEXT)")
    except sqlite3.OperationalError as error:
        lock.close()
        if "locked" in str(error):
            raise ModelError(
                f"another process works on {str(path)!r}; wait for it, or end it; hbbogie study status shows it."
            ) from error
        raise _disk(path, error) from error
    return lock


def _unlock(lock: sqlite3.Connection) -> None:
    with closing(lock):
        lock.rollback()


def _disk(path: Path, error: sqlite3.Error | OSError) -> ModelError:
    """Return the sentence for what SQLite says when it cannot write."""
    folder = path.resolve().parent
    text = str(error)
    if not os.path.isdir(folder):
        reason = f"the directory {str(folder)!r} does not exist; make it"
    elif (
        not os.access(folder, os.W_OK)
        or (path.exists() and not os.access(path, os.W_OK))
        or "readonly" in text
        or "unable to open" in text
    ):
        reason = "it or its directory is read-only; give another place"
    elif "full" in text or "I/O" in text:
        safe = " What was finished before is safe; go on with --resume" if path.exists() else ""
        reason = f"the disk is full or broken; make room.{safe}"
    else:
        reason = text
    return ModelError(f"cannot write the study {str(path)!r}: {reason} (SQLite: {text}).")
