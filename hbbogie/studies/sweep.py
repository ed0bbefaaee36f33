"""The verb `sweep`: a job at many points, on any executor, into a store, with failures as rows."""

from __future__ import annotations

import concurrent.futures as cf
import multiprocessing
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hbbogie.errors import ModelError, unknown_name
from hbbogie.problem import load_problem
from hbbogie.studies.dataset import dataset_of
from hbbogie.studies.jobs import JOBS, Outputs
from hbbogie.studies.optional import required
from hbbogie.studies.sampling import Points, as_points
from hbbogie.studies.store import NOMINAL, Store
from hbbogie.studies.tasks import Outcome, Task, failure, run_point, start_worker, versions
from hbbogie.system import System

if TYPE_CHECKING:
    import xarray as xr

Progress = Callable[[str, float | None], None]
TRIES = 2  # times a point may kill the worker it runs on
SILENT = 10  # pools that may break in a row without any answer
DEADLY = f"the worker process died {TRIES} times on this point: out of memory, or a crash in native code"
EVERY = 0.2  # s between two reports of progress
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


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
        "critical", "cycles", "branch", "compare", "file.py:function", or a function (system, **options) -> dict of
        numbers and text, among them if need be ``status``, a sentence, and ``failed``.
    points : Points, mapping or sequence of mappings
        From `hbbogie.studies.grid`, `latin_hypercube`, `sobol`, ...; a mapping from name to values is a grid, a
        sequence of mappings a list.
    problem : str or System
        Name of a shipped problem, path of a problem file, or a system.
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
        Whether to go on though the problem, the job, its options or the points have changed. What was finished at
        points with the same values is kept.
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
    ``sweep("critical", {"lam": [0.04, 0.05], "K2": [8e6, 10e6]}, problem="yang1995", store="map.db")``
    """
    chosen = as_points(points)
    if isinstance(problem, str):
        problem = str(load_problem(problem).__file__) if problem.endswith(".py") else problem
    task = Task(problem, job, dict(values or {}), dict(options or {}))
    chosen.check(task.system())
    _ = task.function  # raises where there is none
    if sum(x is not None for x in (executor, workers, scheduler)) > 1:
        raise ModelError("sweep: give one of executor, workers and scheduler, or none of them.")
    keep = _opened(task, chosen, store, resume, accept_changes)
    try:
        if retry_failed:
            keep.forget_failed()
        with _runner(task, executor, workers, scheduler) as runner:
            _drive(runner, keep, progress or (lambda message, fraction: None))
        return dataset_of(keep, task.system(), task.function)
    finally:
        keep.close()


def _opened(task: Task, points: Points, path: str | Path | None, resume: bool, accept: bool) -> Store:
    """Return the store, new or checked against what is asked for."""
    about = {
        "problem": task.problem.name if isinstance(task.problem, System) else task.problem,
        "job": task.job_name,
        "values": dict(task.values),
        "options": dict(task.options),
        "fingerprints": task.fingerprints(),
        "versions": versions(),
    }
    if path is None or not Path(path).exists():
        return Store.create(path, points, about)
    if not resume:
        p = Store.read(path)
        state = p.progress()
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
                f"{str(path)!r} was begun with {'; '.join(changes)}. What is in it does not belong to what is asked for "
                "now: give another store, or accept_changes=True (--accept-changes) to keep what is finished."
            )
        if changes:
            keep.replace_points(points)
        keep.describe(about)
    except BaseException:
        keep.close()
        raise
    return keep


def _changes(keep: Store, about: Mapping[str, Any], points: Points) -> list[str]:
    """Return what differs between a store and what is asked for, as sentences."""
    before = keep.about()
    old, new = before["fingerprints"], about["fingerprints"]
    found = [f"another {name} (hash {old.get(name)}, now {new[name]})" for name in ("problem", "job") if old.get(name) != new[name]]
    if old.get("options") != new["options"]:
        found.append(f"other options of the job ({old.get('options')}, now {new['options']})")
    kept = keep.points()
    same = kept.names == points.names and kept.values.shape == points.values.shape
    if not same or (kept.values != points.values).any():
        found.append(f"other points ({len(kept)} of {', '.join(kept.names)}, now {len(points)} of {', '.join(points.names)})")
    casadi = before["versions"]["casadi"], about["versions"]["casadi"]
    if found and casadi[0] != casadi[1]:
        found.append(f"CasADi {casadi[0]}, now {casadi[1]}, which alone may change the hash of the problem")
    return found


# --- running ----------------------------------------------------------------------------------


class _Runner:
    """Submits points to an executor; a local pool that broke is built anew."""

    def __init__(self, payload: bytes, build: Callable[[], cf.Executor], rebuilds: bool, window: int):
        self.payload, self.build, self.rebuilds, self.window = payload, build, rebuilds, window
        self.executor = build()

    def submit(self, point: int, values: Mapping[str, float]) -> cf.Future[Outcome]:
        return self.executor.submit(run_point, self.payload, point, values)

    def rebuild(self) -> None:
        self.executor.shutdown(wait=False, cancel_futures=True)
        self.executor = self.build()


class _Here(cf.Executor):
    """Runs what is submitted at once, in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> cf.Future[Any]:
        future: cf.Future[Any] = cf.Future()
        future.set_result(fn(*args, **kwargs))
        return future


@contextmanager
def _runner(
    task: Task, executor: cf.Executor | None, workers: int | None, scheduler: str | None
) -> Iterator[_Runner]:
    """Give the runner of an executor, of a Dask scheduler or of a local pool, and clean up behind it."""
    if scheduler is not None:
        distributed = required("distributed")
        try:
            client = distributed.Client(scheduler, timeout=10, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ModelError(f"no Dask scheduler answers at {scheduler!r} ({error}); start one with: dask scheduler.") from error
        with client:
            threads = sum(client.nthreads().values())
            yield _Runner(task.packed(by_value=True), client.get_executor, False, max(4 * threads, 16))
        return
    if executor is not None:
        window = 4 * int(getattr(executor, "_max_workers", 0) or os.cpu_count() or 1)
        yield _Runner(task.packed(by_value=True), lambda: executor, False, window)
        return
    if workers == 0:
        yield _Runner(task.packed(), _Here, False, 1)
        return
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise ModelError('sweep: put the call below: if __name__ == "__main__": (worker processes import the script).')
    count = workers or cores()
    context = multiprocessing.get_context("spawn")

    def pool() -> cf.Executor:
        return cf.ProcessPoolExecutor(count, mp_context=context, initializer=start_worker)

    with _one_thread_each():
        runner = _Runner(task.packed(), pool, True, 2 * count)
        try:
            yield runner
        finally:
            runner.executor.shutdown(wait=True, cancel_futures=True)


def cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Set what worker processes inherit: one thread for linear algebra."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def _drive(runner: _Runner, keep: Store, report: Progress) -> None:
    """Submit the missing points, a window of them at a time, and store what comes back."""
    waiting = deque(keep.missing())
    meter = _Meter(keep, report)
    flying: dict[cf.Future[Outcome], tuple[int, dict[str, float]]] = {}
    suspects: deque[tuple[int, dict[str, float]]] = deque()
    deaths: dict[int, int] = {}
    silent = 0  # pools in a row that broke before any answer came
    try:
        while waiting or flying or suspects:
            if suspects and not flying:  # one at a time: who kills a worker alone is guilty
                item = suspects.popleft()
                flying[runner.submit(*item)] = item
            while waiting and not suspects and len(flying) < runner.window:
                item = waiting.popleft()
                flying[runner.submit(*item)] = item
            finished, _ = cf.wait(flying, timeout=1.0, return_when=cf.FIRST_COMPLETED)
            broken: list[tuple[int, dict[str, float]]] = []
            for future in finished:
                item = flying.pop(future)
                try:
                    outcome = _outcome(future, item[0], runner.rebuilds)
                except BrokenProcessPool:
                    broken.append(item)
                    continue
                silent = 0
                keep.put(outcome)
                meter.count(outcome)
            if broken:
                broken += flying.values()
                flying.clear()
                silent += 1
                if silent > SILENT:
                    raise ModelError("the worker processes die before any of them answers; see what they print above.")
                if len(broken) == 1:  # several in flight are all suspects and none guilty
                    deaths[broken[0][0]] = deaths.get(broken[0][0], 0) + 1
                for item in broken:
                    if deaths.get(item[0], 0) < TRIES:
                        suspects.append(item)
                    else:
                        lost = failure(item[0], DEADLY)
                        keep.put(lost)
                        meter.count(lost)
                runner.rebuild()
    except KeyboardInterrupt:
        _land(flying, keep)
        raise


def _outcome(future: cf.Future[Outcome], point: int, rebuilds: bool) -> Outcome:
    """Return the outcome of a finished future; raise where the executor as a whole is lost."""
    try:
        return future.result()
    except BrokenProcessPool:
        if rebuilds:
            raise
        raise ModelError("the executor given is broken: one of its processes died; resume with a new one.") from None
    except (cf.CancelledError, cf.BrokenExecutor) as error:
        raise ModelError("the executor was shut down or lost its workers; what is finished is stored, resume.") from error
    except Exception as error:  # from the executor: the job's own are outcomes already
        return failure(point, f"the executor gave up on this point: {type(error).__name__}: {str(error).partition(chr(10))[0]}")


def _land(flying: Mapping[cf.Future[Outcome], Any], keep: Store) -> None:
    """Cancel what has not begun, and store what is in flight when it has come down."""
    running = [future for future in flying if not future.cancel()]
    for future in cf.as_completed(running):
        if future.exception() is None:
            keep.put(future.result())


class _Meter:
    """Counts points and reports their rate and the time left."""

    def __init__(self, keep: Store, report: Progress):
        state = keep.progress()
        self.total, self.done, self.failed, self.report = state.total, state.done, state.failed, report
        self.first, self.start, self.last = state.done, time.monotonic(), 0.0
        report(f"{self.done} of {self.total} points", self.done / self.total)

    def count(self, outcome: Outcome) -> None:
        if outcome.point == NOMINAL:
            return
        self.done, self.failed = self.done + 1, self.failed + outcome.failed
        now = time.monotonic()
        if now - self.last < EVERY and self.done < self.total:
            return
        self.last = now
        rate = (self.done - self.first) / max(now - self.start, 1e-9)
        left = (self.total - self.done) / rate
        text = f"{self.done} of {self.total} points, {rate:.3g} per second, {_duration(left)} left"
        self.report(text + (f", {self.failed} failed" if self.failed else ""), self.done / self.total)


def _duration(seconds: float) -> str:
    """Return a time as people say it."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
