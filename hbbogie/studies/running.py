"""How a study runs: points to an executor, outcomes to the store, workers that die, Ctrl-C."""

from __future__ import annotations

import concurrent.futures as cf
import multiprocessing
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from typing import Any

from hbbogie.curves import Progress
from hbbogie.errors import ModelError
from hbbogie.processes import LOOK, cores, interruptions, one_thread_each
from hbbogie.studies.optional import required
from hbbogie.studies.store import NOMINAL, Store
from hbbogie.studies.tasks import Outcome, Task, check_names, failure, run_point, start_worker

TRIES = 2  # times a point may kill the worker it runs on
SILENT = 10  # points that may kill their workers as long as none has answered
DEADLY = f"the worker process died {TRIES} times on this point: out of memory, or a crash in native code"
EVERY = 0.2  # s between two reports of progress
EVERY_CLUSTER = 2.0  # s between two looks at the workers of a cluster
AHEAD = 16  # points in flight on a cluster, at least
PATIENCE = 0.5  # s; within which Ctrl-C that reached a worker reaches this process

Flying = dict[cf.Future[Outcome], tuple[int, dict[str, float]]]  # points and their values, by what computes them


class Runner:
    """Submits points to an executor that its user owns."""

    def __init__(self, payload: bytes | Task, executor: cf.Executor, window: int):
        self.payload, self.executor, self.window = payload, executor, window

    def room(self) -> int:
        """Return how many points may be in flight."""
        return self.window

    def submit(self, point: int, values: Mapping[str, float]) -> cf.Future[Outcome]:
        """Submit a point."""
        return self.executor.submit(run_point, self.payload, point, values)

    def renew(self, error: cf.BrokenExecutor) -> None:
        """Go on after an executor has lost a process, or raise `ModelError`."""
        raise ModelError("the executor given is broken: one of its processes died; resume with a new one.") from error

    def cancel(self, flying: Iterable[cf.Future[Outcome]]) -> None:
        """Begin no further point."""
        for future in flying:
            future.cancel()

    def kill(self) -> None:
        """Drop what is in flight, as far as that can be done."""


class _Cluster(Runner):
    """Submits points to the workers of a Dask scheduler, which come and go."""

    def __init__(self, payload: bytes | Task, client: Any):
        self.client, self.looked = client, 0.0
        super().__init__(payload, client.get_executor(), AHEAD)

    def room(self) -> int:
        """Return how many points may be in flight: several for each thread of the workers there are now."""
        if time.monotonic() - self.looked > EVERY_CLUSTER:
            self.window = max(4 * sum(self.client.nthreads().values()), AHEAD)
            self.looked = time.monotonic()
        return self.window


class _Pool(Runner):
    """Submits points to a pool of local processes, which is built anew when it breaks."""

    def __init__(self, payload: bytes | Task, count: int):
        context = multiprocessing.get_context("spawn")
        self.stop = context.Event()
        self.build = lambda: cf.ProcessPoolExecutor(count, context, start_worker, (self.stop,))
        super().__init__(payload, self.build(), 2 * count)

    def submit(self, point: int, values: Mapping[str, float]) -> cf.Future[Outcome]:
        """Submit a point; to a pool that has just broken, as a future that says so."""
        try:
            return super().submit(point, values)
        except BrokenProcessPool as error:
            future: cf.Future[Outcome] = cf.Future()
            future.set_exception(error)
            return future

    def renew(self, error: cf.BrokenExecutor) -> None:
        """Take a new pool for the one that broke."""
        self.executor.shutdown(wait=False, cancel_futures=True)
        self.executor = self.build()
        _await_start([self.executor.submit(os.getpid)])

    def cancel(self, flying: Iterable[cf.Future[Outcome]]) -> None:
        """Begin no further point; the workers are told, as a pool with cancelled futures does not survive `kill`."""
        self.stop.set()

    def kill(self) -> None:
        """End the processes at once."""
        for process in list((getattr(self.executor, "_processes", None) or {}).values()):
            process.kill()


class _Here(cf.Executor):
    """Runs what is submitted at once, in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> cf.Future[Any]:
        future: cf.Future[Any] = cf.Future()
        future.set_result(fn(*args, **kwargs))
        return future


@contextmanager
def runner_of(task: Task, executor: cf.Executor | None, workers: int | None, scheduler: str | None) -> Iterator[Runner]:
    """Give the runner of an executor, of a Dask scheduler or of a local pool, and clean up behind it."""
    if scheduler is not None:
        distributed = required("distributed")
        try:
            client = distributed.Client(scheduler, timeout=5, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ModelError(
                f"no Dask scheduler answers at {scheduler!r} ({error}); start one with: dask scheduler."
            ) from error
        with client:
            if not client.nthreads():
                text = (
                    f"no worker has joined the scheduler yet, waiting for one; start some with: dask worker {scheduler}"
                )
                print(text, file=sys.stderr, flush=True)
            yield _Cluster(task.packed(by_value=True), client)
        return
    if executor is not None:
        window = 4 * int(getattr(executor, "_max_workers", 0) or os.cpu_count() or 1)
        yield Runner(task.packed(by_value=True), executor, window)
        return
    if workers == 0:
        yield Runner(task, _Here(), 1)
        return
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise ModelError('sweep: put the call below: if __name__ == "__main__": (worker processes import the script).')
    count = workers or cores()
    with one_thread_each():
        runner = _Pool(task.packed(), count)
        try:
            _await_start([runner.executor.submit(os.getpid) for _ in range(count)])
            yield runner
        finally:
            runner.executor.shutdown(wait=True, cancel_futures=True)


def _await_start(answers: list[cf.Future[int]]) -> None:
    """Wait for the first worker to answer; raise `ModelError` where they cannot even start."""
    try:
        answers[0].result()
    except BrokenProcessPool:
        raise ModelError(
            "the worker processes end as soon as they start; see what they print above. In a script the call stands "
            'below: if __name__ == "__main__":'
        ) from None


def drive(runner: Runner, keep: Store, report: Progress) -> None:
    """Do the missing points and store what comes back.

    At Ctrl-C `KeyboardInterrupt` is raised when what is in flight has come down.
    """
    flying: Flying = {}
    # in this process Ctrl-C is to reach the job
    with nullcontext(lambda: 0) if isinstance(runner.executor, _Here) else interruptions() as pressed:
        try:
            _work(runner, keep, _Meter(keep, report), flying, pressed)
        except KeyboardInterrupt:
            _land(runner, flying, keep, pressed)
            raise


def _work(runner: Runner, keep: Store, meter: _Meter, flying: Flying, pressed: Callable[[], int]) -> None:
    """Submit the missing points, a window of them at a time; ``flying`` holds what is in flight."""
    waiting = deque(keep.missing())
    suspects: deque[tuple[int, dict[str, float]]] = deque()
    deaths: dict[int, int] = {}
    lost, answered = 0, False
    # the nominal point alone: what is wrong with the job or its options shows there
    alone = bool(waiting) and waiting[0][0] == NOMINAL
    while waiting or flying or suspects:
        if suspects and not flying:  # one at a time: who kills a worker alone is guilty
            item = suspects.popleft()
            flying[runner.submit(*item)] = item
        while waiting and not suspects and len(flying) < (1 if alone else runner.room()):
            item = waiting.popleft()
            flying[runner.submit(*item)] = item
        finished, _ = cf.wait(flying, timeout=LOOK, return_when=cf.FIRST_COMPLETED)
        if pressed():
            raise KeyboardInterrupt
        broken: list[tuple[int, dict[str, float]]] = []
        for future in finished:
            item = flying.pop(future)
            try:
                outcome = _outcome(future, item[0], pressed)
            except BrokenProcessPool as error:
                broken.append(item)
                loss = error
                continue
            answered, alone = True, False
            if item[0] == NOMINAL:
                _refuse(outcome, keep)
            keep.put(outcome)
            meter.count(outcome)
        if broken:
            broken += flying.values()
            flying.clear()
            alone = False
            if len(broken) == 1:  # several in flight are all suspects and none guilty
                deaths[broken[0][0]] = deaths.get(broken[0][0], 0) + 1
            for item in broken:
                if deaths.get(item[0], 0) < TRIES:
                    suspects.append(item)
                else:
                    dead = failure(item[0], DEADLY)
                    keep.put(dead)
                    meter.count(dead)
                    lost += 1
            if lost > SILENT and not answered:
                raise ModelError("the worker processes die before any of them answers; see what they print above.")
            runner.renew(loss)


def _refuse(nominal: Outcome, keep: Store) -> None:
    """Raise `ModelError` where the nominal point shows that the job does not fit: it would fail at every point."""
    kind, _, reason = nominal.status.partition(": ")
    if nominal.failed and kind == ModelError.__name__:
        raise ModelError(f"the job cannot be done at the nominal point: {reason}")
    check_names(nominal.outputs, keep.about()["parameters"])


def _outcome(future: cf.Future[Outcome], point: int, pressed: Callable[[], int]) -> Outcome:
    """Return the outcome of a finished future; raise where the executor as a whole is lost."""
    if not future.cancelled() and isinstance(future.exception(), KeyboardInterrupt):
        time.sleep(PATIENCE)  # Ctrl-C at a terminal reaches this process, too
        if pressed():
            raise KeyboardInterrupt
        return failure(point, "KeyboardInterrupt: raised by the job")
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except (cf.CancelledError, cf.BrokenExecutor) as error:
        raise ModelError(
            "the executor was shut down or lost its workers; what is finished is stored, resume."
        ) from error
    except Exception as error:  # from the executor: the job's own are outcomes already
        return failure(
            point, f"the executor gave up on this point: {type(error).__name__}: {str(error).partition(chr(10))[0]}"
        )


def _land(runner: Runner, flying: Flying, keep: Store, pressed: Callable[[], int]) -> None:
    """Begin nothing more, and store what is in flight when it has come down; drop it at a second Ctrl-C."""
    runner.cancel(flying)
    waiting, said = set(flying), False
    while True:
        cf.wait(waiting, timeout=LOOK)
        for future in [f for f in waiting if f.done()]:
            waiting.remove(future)
            if not future.cancelled() and future.exception() is None:
                keep.put(future.result())
        if not waiting:
            return
        if pressed() > 1:
            runner.kill()
            return
        if not said:
            many = f"{len(waiting)} point{'s' * (len(waiting) != 1)}"
            print(f"waiting for {many} in flight; Ctrl-C again to drop them", file=sys.stderr, flush=True)
            said = True


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
