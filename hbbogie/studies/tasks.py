"""The work at one point, in any process: the task, its outcome, and the code that runs in a worker."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import os
import pickle
import platform
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.model.problem import load_problem, problem_file, system_of
from hbbogie.model.system import System
from hbbogie.parallel.processes import TimeLimit, limited, told_to_stop
from hbbogie.studies.fingerprints import code_of, digest, options_text, problem_hash, source_of, versions
from hbbogie.studies.jobs import BATCHES, JOBS, Outputs, job_function
from hbbogie.threads import one_blas_thread

Item = tuple[int, Mapping[str, float]]  # number and parameter values of a point
RESERVED = ("point", "seconds", "worker", "finished")  # names of a study's own columns, with "status" and "failed"


@dataclass(frozen=True, eq=False)
class Task:
    """What to do at every point of a study.

    Attributes
    ----------
    problem : str or System
        Name of a shipped problem, path of a problem file, or a system.
    job : str or callable
        Name of a job, "file.py:function", or a function ``(system, **options)`` -> dict.
    values : dict
        Parameter values, and options of the problem's builder, common to all points.
    options : dict
        Keywords of the job.
    sources : dict
        Hashes of the code of "problem" and "job" in the process that made the task, where they come from files of the
        user; a worker whose code is another one loads it afresh.
    limit : float or None, s
        Longest time for one point.
    """

    problem: str | System
    job: str | Callable[..., Outputs]
    values: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    limit: float | None = None

    def system(self) -> System:
        """Return the system at the values common to all points."""
        if isinstance(self.problem, System):
            return self.problem.with_parameters(**self.values)
        return system_of(load_problem(self.problem), **self.values)

    @property
    def function(self) -> Callable[..., Outputs]:
        """The job's function."""
        return job_function(self.job)

    @property
    def batches(self) -> bool:
        """Whether the job can be done at many points together."""
        return self.function in BATCHES and self.options.get("method") == "batch"

    @property
    def job_name(self) -> str:
        """The job's name."""
        return self.job if isinstance(self.job, str) else f"{self.job.__module__}:{self.job.__qualname__}"

    def packed(self, by_value: bool = False) -> bytes:
        """Return the task for another process; ``by_value`` where that cannot import the script that is running."""
        pack, own = pickle.dumps, getattr(self.job, "__module__", "") == "__main__"
        nowhere = not hasattr(sys.modules["__main__"], "__file__")  # typed in, with no file to be imported
        if (by_value or nowhere) and importlib.util.find_spec("cloudpickle"):
            pack = importlib.import_module("cloudpickle").dumps
        try:
            if own and nowhere and pack is pickle.dumps:
                raise pickle.PicklingError("it is in no file, and cloudpickle is not installed")
            return pickle.dumps((problem_file(self.job), pack(replace(self, sources=self.loaded()))))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise ModelError(
                f"job {self.job_name!r} or its options cannot be sent to another process ({error}); define the "
                "function at the top level of a file, or run with workers=0."
            ) from error

    def loaded(self) -> dict[str, str]:
        """Return the hashes of the code that this process has loaded of the user's files."""
        found = {}
        if isinstance(self.problem, str) and self.problem.endswith(".py"):
            found["problem"] = str(load_problem(self.problem).__dict__["__source_hash__"])
        if not isinstance(self.job, str):
            found["job"] = digest(repr(code_of(self.job)))
        elif self.job not in JOBS:
            found["job"] = str(load_problem(self.job.rpartition(":")[0]).__dict__["__source_hash__"])
        return found

    def current(self) -> Task:
        """Return the task with the code it was made with; raise `ModelError` where this machine has another.

        Files are loaded afresh when they have changed; a function of an imported module needs that to be done here.
        """
        task, wanted = self, self.sources.get("job")
        if wanted and callable(self.job) and self.loaded()["job"] != wanted and _importable(self.job):
            found: Any = importlib.reload(sys.modules[self.job.__module__])
            for name in self.job.__qualname__.split("."):
                found = getattr(found, name, None)
            task = replace(self, job=found if callable(found) else self.job)
        have = task.loaded()
        for what, hashed in self.sources.items():
            if have.get(what) != hashed:
                raise ModelError(
                    f"the {what} on {platform.node()} is not that of the study (hash {have.get(what)}, the study's "
                    f"{hashed}); bring its file up to date there, or start the workers afresh."
                )
        return task

    def fingerprints(self) -> dict[str, str]:
        """Return hashes of what decides the results: of the problem, of the job, of its options."""
        return {
            "problem": problem_hash(self.system()),
            "job": self._job_hash(),
            "options": options_text(self.options),
        }

    def _job_hash(self) -> str:
        if callable(self.job):
            return digest(source_of(self.job) + repr(code_of(self.job)))
        return f"{self.job} of hbbogie {versions()['hbbogie']}" if self.job in JOBS else self.loaded()["job"]


def _importable(function: Callable[..., Any]) -> bool:
    """Tell whether a function stands at the top of a module that can be imported, and so loaded again."""
    spec = getattr(sys.modules.get(function.__module__), "__spec__", None)
    return spec is not None and "<" not in function.__qualname__ and problem_file(function) is None


@dataclass(frozen=True)
class Outcome:
    """What came of one point.

    Attributes
    ----------
    point : int
    outputs : dict
        Numbers and text by name; empty of a failed point.
    status : str
        A sentence.
    failed : bool
    seconds : float
        Time it took.
    worker : str
        Host and process that computed it.
    error : str
        Name of the exception that ended it; empty where none did, and in an outcome read from a store.
    """

    point: int
    outputs: dict[str, Any]
    status: str
    failed: bool
    seconds: float
    worker: str
    error: str = ""


def failure(point: int, reason: str, seconds: float = float("nan"), worker: str = "", error: str = "") -> Outcome:
    """Return the outcome of a point that has no answer."""
    return Outcome(point, {}, _encodable(reason), True, seconds, worker, error)


def _encodable(text: str) -> str:
    """Return a text with what no file can hold, such as bytes of a file name that are no text, as escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


@functools.lru_cache(maxsize=2)
def _ready(payload: bytes | Task) -> tuple[System, Callable[..., Outputs], dict[str, Any], float | None]:
    """Return the system, the job, its options and the limit of time: built once in a worker, with all functions."""
    task = payload if isinstance(payload, Task) else _unpacked(payload)
    return task.system(), task.function, dict(task.options), task.limit


def _unpacked(payload: bytes) -> Task:
    """Return a task from another process."""
    file, packed = pickle.loads(payload)
    if file is not None:
        load_problem(file)  # the module of the job: no import finds it
    task: Task = pickle.loads(packed)
    return task.current()


@one_blas_thread()
def run_point(payload: bytes | Task, point: int, values: Mapping[str, float], study: str = "") -> Outcome:
    """Do the job at one point; whatever goes wrong becomes an outcome.

    Parameters
    ----------
    payload : bytes or Task
        A packed `Task`; itself where it stays in its process.
    point : int
    values : mapping from name to float
        Parameter values, in the unit of each.
    study : str
        What `stop_study` calls the study.

    Raises
    ------
    concurrent.futures.CancelledError
        In a worker that is to begin no further point.
    """
    if study in _stopped or told_to_stop():
        raise CancelledError
    start, worker = time.perf_counter(), f"{platform.node()}:{os.getpid()}"
    limit: float | None = None
    is_over: Callable[[], bool] = bool
    try:
        system, job, options, limit = _ready(payload)
        with limited(limit) as is_over:
            outputs, status, failed = _checked(job(system.with_parameters(**values), **options), values)
        if is_over():  # the exception was lost in native code
            raise TimeLimit
    except (Exception, SystemExit, KeyboardInterrupt, TimeLimit) as error:
        if is_over():
            reason = f"the time limit of {limit:g} s for a point is over"
            return failure(point, reason, time.perf_counter() - start, worker)
        inside_casadi = isinstance(error, Exception) and "KeyboardInterrupt" in str(error)
        if (inside_casadi or isinstance(error, KeyboardInterrupt)) and _hears_interrupts():
            raise KeyboardInterrupt from error
        # of the first line only: CasADi adds its call stack
        reason = str(error).strip().partition("\n")[0] or "no message"
        kind = type(error).__name__
        return failure(point, f"{kind}: {reason}", time.perf_counter() - start, worker, kind)
    return Outcome(point, outputs, status, failed, time.perf_counter() - start, worker)


def run_points(payload: bytes | Task, items: Sequence[Item], study: str = "") -> list[Outcome]:
    """Do the job at some points: together where the job can, else one by one; return the outcomes of those done.

    Parameters
    ----------
    payload : bytes or Task
        A packed `Task`; itself where it stays in its process.
    items : sequence of (int, mapping from name to float)
        Number and parameter values of each point.
    study : str
        What `stop_study` calls the study.
    """
    if study in _stopped or told_to_stop():
        raise CancelledError
    if len(items) > 1 and (together := _run_together(payload, items)):
        return together
    done: list[Outcome] = []
    for point, values in items:
        try:
            done.append(run_point(payload, point, values, study))
        except CancelledError:
            if not done:
                raise
            break
    return done


@one_blas_thread()
def _run_together(payload: bytes | Task, items: Sequence[Item]) -> list[Outcome]:
    """Return the outcomes of points that the job does together; none where they have to be done one by one."""
    start, worker = time.perf_counter(), f"{platform.node()}:{os.getpid()}"
    try:
        system, job, options, limit = _ready(payload)
        with limited(limit):
            found = BATCHES[job](system, [values for _, values in items], **options)
            checked = [_checked(each, values) for each, (_, values) in zip(found, items, strict=True)]
    except (Exception, TimeLimit):  # whatever it is: the points themselves will show it
        return []
    seconds = (time.perf_counter() - start) / len(items)
    return [Outcome(point, *each, seconds, worker) for (point, _), each in zip(items, checked, strict=True)]


def _hears_interrupts() -> bool:
    """Tell whether Ctrl-C reaches this thread; where it does not, KeyboardInterrupt is the job's own."""
    return threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) != signal.SIG_IGN


def _checked(returned: Any, inputs: Mapping[str, float]) -> tuple[dict[str, Any], str, bool]:
    """Return outputs, status and failure as a job returned them; raise `ModelError` for anything else."""
    if not isinstance(returned, Mapping):
        raise ModelError(f"the job returned {type(returned).__name__}; return a dict of numbers and text by name.")
    outputs = dict(returned)
    status, failed = outputs.pop("status", "done"), outputs.pop("failed", False)
    if not isinstance(status, str):
        raise ModelError(f"the job returned status = {status!r}; the status is a sentence. Rename the output.")
    if not isinstance(failed, bool | np.bool_):
        raise ModelError(f"the job returned failed = {failed!r}; give True or False, or rename the output.")
    check_outputs(outputs, inputs)
    return {name: _plain(name, value) for name, value in outputs.items()}, _encodable(status), bool(failed)


def check_outputs(outputs: Iterable[Any], inputs: Iterable[str]) -> None:
    """Raise `ModelError` where an output is named like an input or like what every study has besides."""
    for name in outputs:
        if not isinstance(name, str):
            raise ModelError(f"the job returned an output named {name!r}; a name is text.")
        if name in ("", ".") or "/" in name or not name.isprintable():
            raise ModelError(
                f"the job returned an output named {name!r}, which NetCDF cannot hold; rename it, with letters, digits "
                "and underscores."
            )
        if name in inputs or name in RESERVED:
            what = "an input" if name in inputs else "what every study has besides its outputs"
            raise ModelError(f"the job returned an output {name!r}, which is the name of {what}; rename the output.")


def _plain(name: str, value: Any) -> float | str | None:
    """Return an output as a number or text; NaN becomes None, which JSON knows."""
    if value is None or isinstance(value, str):
        return value if value is None else _encodable(value)
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ModelError(
            f"the job returned {name!r} of type {type(value).__name__}; return numbers and text only."
        ) from None
    return None if number != number else number


_stopped: set[str] = set()  # in a worker of a cluster, which lives on: studies of which it begins no further point


def stop_study(study: str) -> None:
    """Begin no further point of a study in this process."""
    _stopped.add(study)
