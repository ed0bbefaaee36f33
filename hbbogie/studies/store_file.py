"""The file of a study's store: its lock, the room it reserves, and sentences for what SQLite refuses."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path

from hbbogie.errors import ModelError

LEAST, EACH = 1024 * 1024, 4000  # bytes reserved: at least, and for each point
CHECKPOINT = 192  # pages of the write-ahead log, which then stays within the room reserved for it


def is_store(path: str | Path) -> bool:
    """Tell by its first bytes whether a file is a database."""
    try:
        with open(path, "rb") as file:
            return file.read(16) == b"SQLite format 3\0"
    except OSError:
        return False


def existing(path: str | Path) -> Path:
    """Return the path of a file; raise `ModelError` where there is none."""
    if not Path(path).is_file():
        raise ModelError(f"no study {str(path)!r}; give the path of a store written before.")
    return Path(path)


def connect(path: Path) -> sqlite3.Connection:
    """Open a store to write to it, with room in its write-ahead log."""
    connection = sqlite3.connect(path, timeout=10.0)
    try:
        connection.execute("PRAGMA journal_mode = WAL")
        # in write-ahead mode this is safe against the death of the process, and writes to disk at checkpoints
        connection.execute("PRAGMA synchronous = NORMAL")
        connection.execute(f"PRAGMA wal_autocheckpoint = {CHECKPOINT}")
        reserve(connection, LEAST)  # also of the log, whose room is used again and again
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def reserve(connection: sqlite3.Connection, size: int) -> None:
    """Claim room in the file and in its log: what is deleted again stays in it as free pages."""
    connection.execute("CREATE TABLE IF NOT EXISTS reserve (room BLOB)")
    connection.execute("INSERT INTO reserve VALUES (zeroblob(?))", (size,))
    connection.commit()
    connection.execute("DROP TABLE reserve")
    connection.commit()


def room(connection: sqlite3.Connection) -> int:
    """Return how many bytes of the file are free."""
    pages, size = (connection.execute(f"PRAGMA {name}").fetchone()[0] for name in ("freelist_count", "page_size"))
    return int(pages * size)


def remove(part: Path) -> None:
    """Remove what is there of a store that was not finished, and its journals."""
    for ending in ("", "-journal", "-wal", "-shm"):
        Path(f"{part}{ending}").unlink(missing_ok=True)


def locked(path: Path) -> sqlite3.Connection:
    """Return the connection that holds a study's lock, a file beside it locked by SQLite, on every platform alike."""
    try:
        lock = sqlite3.connect(f"{path}.lock", timeout=0.0, isolation_level=None)
    except sqlite3.OperationalError as error:
        raise refusal(path, error) from error
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
        raise refusal(path, error) from error
    return lock


def unlock(lock: sqlite3.Connection) -> None:
    """Give a lock back."""
    with closing(lock):
        lock.rollback()


def refusal(path: Path, error: sqlite3.Error | OSError) -> ModelError:
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
