"""The function `sweep`: a job at many points, on any executor, with a store, and with failures as rows."""

from __future__ import annotations

import concurrent.futures as cf
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie.errors import ModelError, door, positive, whole
from hbbogie.model.problem import default_interval, load_problem, shipped_problems
from hbbogie.model.system import System
from hbbogie.parallel.processes import interruptions
from hbbogie.progress import Progress, silent
from hbbogie.studies.dataset import dataset_of, describe_units
from hbbogie.studies.fingerprints import versions
from hbbogie.studies.jobs import JOBS, SEARCHING, Outputs, job_function
from hbbogie.studies.options import wrong_option
from hbbogie.studies.runners import runner_of
from hbbogie.studies.running import drive
from hbbogie.studies.sampling import Points, as_points
from hbbogie.studies.store import Store
from hbbogie.studies.store_rows import listed
from hbbogie.studies.tasks import Task

if TYPE_CHECKING:
    import xarray as xr


@interruptions(raising=True)  # counted from here on: CasADi loses the exception while the system is built, too
@door(problem=(str, os.PathLike, System), scheduler=str)
def sweep(
    job: str | Callable[..., Outputs],
    points: Points | Mapping[str, Any] | Sequence[Mapping[str, float]],
    *,
    problem: str | System,
    values: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
    store: str | Path | None = None,
    resume: bool = False,
    retry_failed: bool = False,
    accept_changes: bool = False,
    limit: float | None = None,
    batch: int = 48,
    executor: cf.Executor | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Do a job at many parameter points.

    Every point has its row in the result, also one that failed: its ``failed`` is true and its ``status`` says why.
    A script that calls this with local worker processes does so below ``if __name__ == "__main__":``.

    Parameters
    ----------
    job : str or callable
        "critical", "cycles", "branch", "compare", "file.py:function", or a function ``(system, **options)`` -> dict of
        numbers and text. ``status``, a sentence, and ``failed`` may be among them.
    points : Points, mapping or sequence of mappings
        From `hbbogie.studies.grid`, `latin_hypercube`, `sobol`, ...; a mapping from name to values is a grid, a
        sequence of mappings a list.
    problem : str or System
        Name of a shipped problem, path of a problem's file or folder, or a system.
    values : mapping, optional
        Parameter values common to all points, by name, in the unit of each.
    options : mapping, optional
        Keywords of the job.
    store : str or path, optional
        SQLite file to which every finished point goes at once. Without it the results are in memory only.
    resume : bool
        Whether to go on with an existing store; only what is missing is computed.
    retry_failed : bool
        Whether to compute failed points anew when resuming.
    accept_changes : bool
        Whether to go on although the problem, the job, its options or the points have changed. What was finished at
        points with the same values is kept; the attribute ``changes`` of the result says what changed and when, and
        ``finished`` which rows are older.
    limit : float, optional, s
        Time after which a point is a failed row. It holds for points in the main thread of a process, as those of the
        local pool are, and not on Windows.
    batch : int
        How many points a worker does together, where the job can do that: "critical" with ``method="batch"``. Then the
        limit is for all of them; those of a batch that fails or takes longer are done one by one.
    executor : concurrent.futures.Executor, optional
        Where to run; it is not shut down. A pool of local processes, each with one BLAS thread, where left out.
    workers : int, optional
        Processes of the local pool, as many as there are cores where left out; 0 runs in this process.
    scheduler : str, optional
        Address of a Dask scheduler, such as "tcp://host:8786", to run there.
    progress : callable, optional
        Called with (message, fraction done).

    Returns
    -------
    xarray.Dataset
        Along "point": inputs as coordinates, outputs, ``status``, ``failed``, ``seconds``; attributes say what
        problem, job, seed and versions.

    Raises
    ------
    ModelError
        For wrong input, before any work starts.
    KeyboardInterrupt
        At Ctrl-C, after the points in flight have been stored.

    Examples
    --------
    The fold of this system lies at mu = -a^2/4.

    >>> data = sweep("critical", {"a": [0.5, 1.0]}, problem="bautin", workers=0)
    >>> [round(float(fold), 6) for fold in data["fold"]]
    [-0.0625, -0.25]
    """
    chosen = as_points(points)
    task = task_of(job, problem, values, options)
    if limit is not None:
        task = replace(task, limit=positive("limit", limit, "s"))
    system, function = task.system(), task.function
    chosen = chosen.of_system(system)
    if both := [name for name in chosen.names if name in task.values]:
        raise ModelError(f"sweep: the points give values of {both[0]!r}, and so do the common ones; leave one out.")
    sought = task.options.get("parameter") if function in SEARCHING else None
    if sought in chosen.names:
        raise ModelError(
            f"sweep: the points give values of {sought!r}, which the job {task.job_name!r} looks for or varies by "
            'itself; leave it out, take another parameter=, or the job "cycles" for the cycles at its values.'
        )
    if sum(x is not None for x in (executor, workers, scheduler)) > 1:
        raise ModelError("sweep: give one of executor, workers and scheduler, or none of them.")
    batch = whole("sweep: batch", batch)
    workers = None if workers is None else whole("sweep: workers (0 for this process)", workers, 0)
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise ModelError(f"sweep: executor = {executor!r}; give a concurrent.futures.Executor.")
    begun = store is not None and Path(store).exists()
    keep = _opened(task, chosen, store, resume, accept_changes)
    try:
        if retry_failed:
            keep.forget_failed()
        describe_units(keep, system, function)
        try:
            with chdir("."), runner_of(task, executor, workers, scheduler) as runner:  # a job may go elsewhere
                drive(runner, keep, progress or silent, batch if task.batches else 1)
        except BaseException:
            with suppress(ModelError):  # of a full disk, which would hide the reason
                describe_units(keep, system, function)
            raise
        describe_units(keep, system, function)
        return dataset_of(keep)
    except ModelError:
        empty = not begun and not keep.outcomes()  # refused, with nothing to go on with
        keep.close()
        if store is not None and empty:
            Path(store).unlink(missing_ok=True)
        raise
    finally:
        keep.close()


def task_of(
    job: str | Callable[..., Outputs],
    problem: str | System,
    values: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Task:
    """Return the task, with the problem's own parameter and range for the jobs that ask for them."""
    if wrong := wrong_option(job_function(job), options or {}):
        raise ModelError(wrong[1])
    module = ModuleType("none")
    if isinstance(problem, str):
        module = load_problem(problem)
        problem = problem if problem in shipped_problems() else str(module.__file__)
    task = Task(problem, job, dict(values or {}), dict(options or {}))
    if not isinstance(job, str) or job not in JOBS:
        return task
    parameter, interval = default_interval(module, task.system(), task.options.get("parameter"))
    return replace(task, options={"parameter": parameter, "interval": list(interval), **task.options})


def _opened(task: Task, points: Points, path: str | Path | None, resume: bool, accept: bool) -> Store:
    """Return the store, new or checked against what is asked for."""
    about: dict[str, Any] = {
        "problem": task.problem.name if isinstance(task.problem, System) else task.problem,
        "job": task.job_name,
        "values": dict(task.values),
        "options": dict(task.options),
        "fingerprints": task.fingerprints(),
        "versions": versions(),
    }
    if path is not None and Path(path).exists() and not Path(path).is_file():
        raise ModelError(f"{str(path)!r} is no file; give the path of a store, such as 'study.db'.")
    if path is None or not Path(path).exists():
        return Store.create(path, points, about)
    if not resume:
        p = Store.read(path)
        state = p.counts()
        p.close()
        raise ModelError(
            f"{str(path)!r} exists, with {state.done} of {state.total} points finished; go on with resume=True "
            "(--resume), or give another store."
        )
    keep = Store.open(path)
    try:
        changes = _changes(keep, about, points)
        if changes and not accept:
            raise ModelError(
                f"{str(path)!r} was begun with {'; '.join(changes)}. What is in it is not what is asked for now: "
                "give another store, or accept_changes=True (--accept-changes) to keep what is finished."
            )
        if damaged := keep.counts().damaged:
            changes = [*changes, f"{len(damaged)} damaged rows, computed anew (points {listed(damaged)})"]
        if changes:
            keep.replace_points(points)
            now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
            about["changes"] = [*keep.about().get("changes", []), {"accepted": now, "what": changes}]
        keep.describe(about)
    except BaseException:
        keep.close()
        raise
    return keep


def _changes(keep: Store, about: Mapping[str, Any], points: Points) -> list[str]:
    """Return what differs between a store and what is asked for, as sentences."""
    before = keep.about()
    old, new = before["fingerprints"], about["fingerprints"]
    found = [
        f"another {name} (hash {old.get(name)}, now {new[name]})"
        for name in ("problem", "job")
        if old.get(name) != new[name]
    ]
    if old.get("options") != new["options"]:
        found.append(f"other options of the job ({old.get('options')}, now {new['options']})")
    names, kept = tuple(before["parameters"]), keep.inputs()
    known = ~np.isnan(kept)  # of damaged rows nothing is known
    if names != points.names or kept.shape != points.values.shape or (kept != points.values)[known].any():
        found.append(
            f"other points ({len(kept)} of {', '.join(names)}, now {len(points)} of {', '.join(points.names)})"
        )
    casadi = before["versions"]["casadi"], about["versions"]["casadi"]
    if found and casadi[0] != casadi[1]:
        found.append(f"CasADi {casadi[0]}, now {casadi[1]}, which alone may change the hash of the problem")
    return found
