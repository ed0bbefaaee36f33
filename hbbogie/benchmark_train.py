"""The benchmark of trains: time and memory of each step over the number of vehicles, each train in its own process."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from hbbogie import HarmonicBalance, floquet, hopf_points, load_problem, solve
from hbbogie.branches import cycle_after
from hbbogie.results import Orbit

VEHICLES = (1, 2, 4, 8, 16)
SPEED, SPAN, HARMONICS = 65.0, (60.0, 110.0), 31  # m/s, m/s, highest harmonic
START = {"y1_1": 0.01, "y2_1": 0.01}  # m; the front bogie of the first vehicle is displaced


def measured(n: int) -> dict[str, float]:
    """Return what the steps on a train take [s] of processor time, and the memory of this process [MB].

    Parameters
    ----------
    n : int
        Number of vehicles.
    """
    spent: dict[str, float] = {}

    def take(what: str, job: Callable[[], Any]) -> Any:
        begin = time.process_time()
        result = job()
        spent[what] = time.process_time() - begin
        return result

    system = take("equations of motion", lambda: load_problem("train").train(n, V=SPEED))
    balance = HarmonicBalance(HARMONICS)
    equations = take("balance, H = 31", lambda: _ready(balance, system))
    cycle: Orbit = take("a cycle, from a displaced bogie", lambda: cycle_after(system, START))
    guess = cycle.replace(omega=1.001 * cycle.omega)
    take("Newton from a cycle near by", lambda: solve(equations, guess, method="newton"))
    verdict = take("its multipliers", lambda: floquet(system, cycle)).verdict
    spent["memory [MB]"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1e6 if sys.platform == "darwin" else 1e3
    )
    found = take("all Hopf points", lambda: hopf_points(system, "V", SPAN))
    if len(found) != 2 * n or verdict != "stable":
        raise RuntimeError(f"train of {n}: {len(found)} Hopf points of {2 * n}, the cycle is {verdict}")
    return spent


def _ready(balance: HarmonicBalance, system: Any) -> Any:
    equations = balance.equations(system)
    equations.derivatives(())
    return equations


def measure_trains() -> dict[int, dict[str, float]]:
    """Return what `measured` gives for each number of vehicles, each in a new process."""
    found = {}
    for n in VEHICLES:
        command = [sys.executable, "-m", "hbbogie.benchmark_train", str(n)]
        found[n] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def print_trains(found: dict[int, dict[str, float]]) -> None:
    """Print a table, one column for each number of vehicles."""
    rows = list(found[VEHICLES[0]])
    width = max(map(len, rows))
    print("trains; processor time in s, memory up to the multipliers")
    print(f"{'vehicles':<{width}}" + "".join(f"{n:>9}" for n in found))
    for row in rows:
        digits = 0 if "memory" in row else 2
        print(f"{row:<{width}}" + "".join(f"{one[row]:9.{digits}f}" for one in found.values()))


if __name__ == "__main__":
    print(json.dumps(measured(int(sys.argv[1]))))
