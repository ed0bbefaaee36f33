"""Running a study: points go to a runner, outcomes to the store; dying workers and Ctrl-C are handled."""

from __future__ import annotations

import concurrent.futures as cf
import sys
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool

from hbbogie.errors import ModelError
from hbbogie.parallel.processes import LOOK, interruptions
from hbbogie.progress import Progress
from hbbogie.studies.runners import Promise, Runner, lost_executor
from hbbogie.studies.store import Store
from hbbogie.studies.store_rows import NOMINAL
from hbbogie.studies.tasks import Outcome, check_outputs, failure

TRIES = 2  # times a point may kill the worker it runs on
SILENT = 10  # points that may kill their workers as long as none has answered
DEADLY = f"the worker process died {TRIES} times on this point: out of memory, or a crash in native code"
MISTAKES = (  # what a wrong option or a mistake in a job's code raises, unlike work that does not succeed
    *("ModelError", "TypeError", "ValueError", "KeyError", "IndexError", "AttributeError", "NameError", "ImportError"),
    *("ModuleNotFoundError", "AssertionError"),
)
EVERY = 0.2  # s between two reports of progress
PATIENCE = 0.5  # s; within which Ctrl-C that reached a worker reaches this process

Flying = dict[Promise, list[tuple[int, dict[str, float]]]]  # points and their values, by what computes them


def drive(runner: Runner, keep: Store, report: Progress, together: int = 1) -> None:
    """Do the missing points, some of them together, and store what comes back.

    At Ctrl-C `KeyboardInterrupt` is raised when the points in flight are finished.
    """
    flying: Flying = {}
    with interruptions(raising=runner.here) as pressed:  # in this process Ctrl-C is to reach the job
        try:
            _work(runner, keep, _Meter(keep, report), flying, pressed, together)
        except KeyboardInterrupt:
            if not runner.here:  # what a job returns in spite of Ctrl-C may be what CasADi made of that
                _land(runner, flying, keep, pressed)
            raise


def _work(
    runner: Runner, keep: Store, meter: _Meter, flying: Flying, pressed: Callable[[], int], together: int
) -> None:
    """Submit the missing points, a window of them at a time; ``flying`` holds what is in flight."""
    waiting = deque(keep.missing())
    suspects: deque[tuple[int, dict[str, float]]] = deque()
    deaths: dict[int, int] = {}
    lost, answered = 0, False
    # the nominal point alone: what is wrong with the job or its options shows there
    alone = bool(waiting) and waiting[0][0] == NOMINAL
    while waiting or flying or suspects:
        if suspects and not flying:  # one at a time: who kills a worker alone is guilty
            some = [suspects.popleft()]
            flying[runner.submit(some)] = some
        while waiting and not suspects and len(flying) < (1 if alone else runner.room()):
            some = [waiting.popleft() for _ in range(1 if alone else min(together, len(waiting)))]
            flying[runner.submit(some)] = some
        finished, _ = cf.wait(flying, timeout=LOOK, return_when=cf.FIRST_COMPLETED)
        if pressed():
            raise KeyboardInterrupt
        broken: list[tuple[int, dict[str, float]]] = []
        for future in finished:
            some = flying.pop(future)
            try:
                outcomes = _outcomes(future, some, pressed)
            except BrokenProcessPool as error:
                broken += some
                loss = error
                continue
            answered, alone = True, False
            for outcome in outcomes:
                if outcome.point == NOMINAL:
                    _refuse(outcome, keep)
                keep.put(outcome)
                meter.count(outcome)
        if broken:
            broken += [item for some in flying.values() for item in some]
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
    if nominal.error in MISTAKES:
        reason = nominal.status.removeprefix(f"{ModelError.__name__}: ")
        raise ModelError(f"the job cannot be done at the nominal point: {reason}")
    check_outputs(nominal.outputs, keep.about()["parameters"])


def _outcomes(future: Promise, items: list[tuple[int, dict[str, float]]], pressed: Callable[[], int]) -> list[Outcome]:
    """Return the outcomes of a finished future; raise where the executor as a whole is lost."""
    if not future.cancelled() and isinstance(future.exception(), KeyboardInterrupt):
        time.sleep(PATIENCE)  # Ctrl-C at a terminal reaches this process, too
        if pressed():
            raise KeyboardInterrupt
        return [failure(point, "KeyboardInterrupt: raised by the job") for point, _ in items]
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except (cf.CancelledError, cf.BrokenExecutor) as error:
        raise lost_executor() from error
    except Exception as error:  # from the executor: the job's own are outcomes already
        reason = f"the executor gave up on this point: {type(error).__name__}: {str(error).partition(chr(10))[0]}"
        return [failure(point, reason) for point, _ in items]


def _land(runner: Runner, flying: Flying, keep: Store, pressed: Callable[[], int]) -> None:
    """Begin no further point, and store those in flight when they are finished; a second Ctrl-C drops them."""
    runner.cancel(flying)
    waiting, said = set(flying), False
    while True:
        cf.wait(waiting, timeout=LOOK)
        for future in [f for f in waiting if f.done()]:
            waiting.remove(future)
            if not future.cancelled() and future.exception() is None:
                for outcome in future.result():
                    keep.put(outcome)
        if not waiting:
            return
        if pressed() > 1:
            runner.kill()
            return
        if not said:
            count = sum(len(flying[future]) for future in waiting)
            many = f"{count} point{'s' * (count != 1)}"
            print(f"waiting for {many} in flight; Ctrl-C again to drop them", file=sys.stderr, flush=True)
            said = True


class _Meter:
    """Counts points and reports their rate and the time left."""

    def __init__(self, keep: Store, report: Progress):
        state = keep.counts()
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
