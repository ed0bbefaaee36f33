"""The store of a study: one SQLite file that survives whatever happens to the process that writes it.

Every finished point is one transaction. In the write-ahead mode used here, a process that is killed leaves the file as
the last transaction left it. Only one process writes. It holds a lock that the operating system releases when the
process ends. Every row has a checksum, which is compared whenever the row is read.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError
from hbbogie.studies.sampling import Points
from hbbogie.studies.store_file import EACH, LEAST, connect, existing, locked, refusal, remove, reserve, room, unlock
from hbbogie.studies.store_rows import (
    ABOUT,
    COLUMNS,
    DAMAGED,
    NOMINAL,
    VERSION,
    About,
    Row,
    checksum_of,
    empty_rows,
    fill,
    points_described,
    whole_rows,
    write_about,
    write_rows,
)
from hbbogie.studies.tasks import Outcome


@dataclass(frozen=True)
class Counts:
    """How many points of a study there are, and how many are finished.

    Attributes
    ----------
    total, done, failed : int
        Points; the failed ones are among those done.
    seconds : float
        Time that the finished points took, over all workers.
    damaged : tuple of int
        Numbers of the points whose rows are damaged; they count neither as finished nor as missing.
    """

    total: int
    done: int
    failed: int
    seconds: float
    damaged: tuple[int, ...] = ()

    @property
    def missing(self) -> int:
        """Points that are not finished."""
        return self.total - self.done - sum(point != NOMINAL for point in self.damaged)


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
        content = {**about, **points_described(points)}
        if path is None:
            connection = sqlite3.connect(":memory:")
            fill(connection, points, content)
            return cls(target, connection, None)
        lock, part, begun = locked(target), Path(f"{target}.part"), False
        try:
            remove(part)
            with closing(sqlite3.connect(part)) as connection:
                reserve(connection, max(LEAST, EACH * len(points)))
                fill(connection, points, content)
            part.replace(target)  # whole or not at all, whenever the process is killed
            begun = True
            return cls(target, connect(target), lock)
        except (sqlite3.Error, OSError) as error:
            unlock(lock)
            remove(part)
            if begun:
                remove(target)
            raise refusal(target, error) from error

    @classmethod
    def open(cls, path: str | Path) -> Store:
        """Open an existing study to go on with it, and hold its lock.

        Raises
        ------
        ModelError
            When there is no such file, it is no study, it is damaged so that nothing can be added to it, it cannot be
            written, or another process works on it.
        """
        target = existing(path)
        lock, store = locked(target), None
        try:
            with closing(cls.read(target)) as before:  # anything is written
                before._check_structure()
            store = cls(target, connect(target), lock)
            needed = max(LEAST, EACH * len(store.missing())) - room(store._connection)
            if needed > 0:
                reserve(store._connection, needed)
            return store
        except (ModelError, sqlite3.Error) as error:
            if store is None:
                unlock(lock)
            else:
                store.close()
            raise error if isinstance(error, ModelError) else refusal(target, error) from error

    @classmethod
    def read(cls, path: str | Path) -> Store:
        """Open an existing study to look at it, also while another process works on it."""
        target = existing(path)
        try:
            connection = sqlite3.connect(f"{target.resolve().as_uri()}?mode=ro", uri=True, timeout=10.0)
        except sqlite3.Error as error:
            raise refusal(target, error) from error
        store = cls(target, connection, None)
        try:
            store._check()
        except ModelError:
            store.close()
            raise
        return store

    def _check(self) -> None:
        """Raise `ModelError` unless this is the store of a study, of this version."""
        try:
            (layout,) = self._connection.execute("PRAGMA user_version").fetchone()
            self._connection.execute("SELECT name FROM sqlite_schema").fetchall()
        except sqlite3.DatabaseError as error:
            raise ModelError(f"{str(self.path)!r} is damaged, or not the store of a study: {error}.") from error
        if layout != VERSION:
            raise ModelError(
                f"{str(self.path)!r} is not the store of a study, or one of another version of hbbogie (layout "
                f"{layout}; this version reads layout {VERSION}, whose rows have checksums); read it with the version "
                "that wrote it, or run the study anew."
            )

    def _check_structure(self) -> None:
        """Raise `ModelError` where the file is damaged in such a way that writing to it would do further harm."""
        try:
            ((said, *_), *_) = self._connection.execute("PRAGMA quick_check(1)").fetchall()
        except sqlite3.DatabaseError as error:
            said = str(error)
        if said != "ok":
            raise ModelError(
                f"{str(self.path)!r} is damaged ({' '.join(said.split())}), so that nothing can be added to it; take "
                "what is whole with hbbogie study export, and begin a new store."
            )

    def close(self) -> None:
        """Close the file and give its lock back."""
        if self._lock is not None:
            with suppress(sqlite3.Error):  # refused while somebody reads, and then the file stays as it is
                self._connection.execute("PRAGMA journal_mode = DELETE")  # one file, to be read anywhere
        self._connection.close()
        if self._lock is not None:
            unlock(self._lock)
            self._lock = None

    # --- what it is about ---------------------------------------------------------------------

    def describe(self, about: Mapping[str, Any]) -> None:
        """Write down what the study is about, by name; raise `ModelError` when the disk refuses it."""
        with self._writing() as c:
            write_about(c, about)

    def about(self) -> dict[str, Any]:
        """Return what was written down by `describe`; asked for a name that is not there, it raises `ModelError`."""
        found = About()
        for table in ABOUT:
            with suppress(sqlite3.DatabaseError):  # of a damaged page
                for name, value, checksum in self._connection.execute(f"SELECT name, value, checksum FROM {table}"):
                    if checksum == checksum_of((name, value)):
                        found[name] = json.loads(value)
        return found

    # --- points -------------------------------------------------------------------------------

    def put(self, outcome: Outcome) -> None:
        """Write a finished point, in a transaction of its own; raise `ModelError` when the disk refuses it."""
        o, now = outcome, datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        seconds = None if o.seconds != o.seconds else float(o.seconds)  # SQLite knows no NaN
        with self._writing() as c:
            row = whole_rows(self._read("WHERE point = ?", o.point))
            if not row:
                raise ModelError(f"{str(self.path)!r}: point {o.point}: {DAMAGED}.")
            write_rows(c, [(*row[0][:2], json.dumps(o.outputs), o.status, int(o.failed), seconds, o.worker, now)])

    def missing(self) -> list[tuple[int, dict[str, float]]]:
        """Return number and parameter values of the points that are not finished, the nominal one first."""
        return [(row[0], json.loads(row[1])) for row in self._rows()[0] if row[2] is None]

    def forget_failed(self) -> None:
        """Make the failed points missing ones, to be tried again."""
        failed = [row for row in self._rows()[0] if row[4]]
        with self._writing() as c:
            write_rows(c, [(*row[:2], *[None] * 6) for row in failed])

    def replace_points(self, points: Points) -> None:
        """Take other points; the outcome of a point with the same values as before is kept."""
        old = {row[1]: row[2:] for row in self._rows()[0] if row[2] is not None and row[0] != NOMINAL}
        with self._writing() as c:
            c.execute("DELETE FROM points")
            write_rows(c, ((*row[:2], *old.get(row[1], row[2:])) for row in empty_rows(points)))
            write_about(c, points_described(points))

    def counts(self) -> Counts:
        """Return how many points there are, how many are finished, and which are damaged."""
        rows, damaged = self._rows()
        done = [row for row in rows if row[2] is not None and row[0] != NOMINAL]
        seconds = sum(row[5] for row in done if row[5] is not None)
        return Counts(self.about()["total"], len(done), sum(row[4] for row in done), seconds, damaged)

    def outcomes(self) -> list[tuple[Outcome, dict[str, float], str]]:
        """Return the outcome, the parameter values and the time of finishing of every point that is finished.

        A damaged row is a failed point whose status says so, with parameter values that are NaN.
        """
        rows, damaged = self._rows()
        names, none = self.about()["parameters"], float("nan")
        found = [(Outcome(i, {}, DAMAGED, True, none, ""), dict.fromkeys(names, none), "") for i in damaged]
        for point, inputs, outputs, status, failed, seconds, worker, finished in rows:
            if outputs is not None:
                time = none if seconds is None else seconds
                outcome = Outcome(point, json.loads(outputs), status, bool(failed), time, worker)
                found.append((outcome, json.loads(inputs), finished))
        return sorted(found, key=lambda each: each[0].point)

    def inputs(self) -> NDArray[np.float64]:
        """Return the parameter values of all points, shape (points, parameters); those of damaged rows are NaN."""
        about = self.about()
        values = np.full((about["total"], len(about["parameters"])), np.nan)
        for row in self._rows()[0]:
            if row[0] != NOMINAL:
                values[row[0]] = list(json.loads(row[1]).values())
        return values

    def _rows(self) -> tuple[list[Row], tuple[int, ...]]:
        """Return the rows that are whole, by number, and the numbers of the damaged ones."""
        numbers = range(NOMINAL, self.about()["total"])
        try:
            found = self._read()
        except sqlite3.DatabaseError:  # a damaged page: take the rows that are on others
            found = []
            for point in numbers:
                with suppress(sqlite3.DatabaseError):
                    found += self._read("WHERE point = ?", point)
        whole = {row[0]: row for row in whole_rows(found)}
        return [whole[i] for i in numbers if i in whole], tuple(i for i in numbers if i not in whole)

    def _read(self, which: str = "", *values: int) -> list[Row]:
        return self._connection.execute(f"SELECT {COLUMNS}, checksum FROM points {which}", values).fetchall()

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """Write in one transaction; raise `ModelError` when the disk refuses it."""
        try:
            with self._connection as connection:
                yield connection
        except sqlite3.Error as error:
            raise refusal(self.path, error) from error
