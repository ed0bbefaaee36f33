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
RUNS = 2  # of each train, of which the best counts
MEMORY = "memory of the process for all of this [MB]"


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
        spent[f"{what} [s]"] = time.process_time() - begin
        return result

    system = take("equations of motion", lambda: load_problem("train").train(n, V=SPEED))
    balance = HarmonicBalance(HARMONICS)
    equations = take("harmonic balance with Jacobian, highest harmonic 31", lambda: _ready(balance, system))
    cycle: Orbit = take("a cycle with verdict, from a displaced bogie", lambda: cycle_after(system, START))
    guess = cycle.replace(omega=1.001 * cycle.omega)
    take("Newton's method from a cycle near by", lambda: solve(equations, guess, method="newton"))
    verdict = take("multipliers of the cycle", lambda: floquet(system, cycle)).verdict
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    spent[MEMORY] = largest / (1e6 if sys.platform == "darwin" else 1e3)
    found = take("all Hopf points from 60 to 110 m/s", lambda: hopf_points(system, "V", SPAN))
    if len(found) != 2 * n or verdict != "stable":
        raise RuntimeError(f"train of {n}: {len(found)} Hopf points of {2 * n}, the cycle is {verdict}")
    return spent


def _ready(balance: HarmonicBalance, system: Any) -> Any:
    equations = balance.equations(system)
    equations.derivatives(())
    return equations


def measure_trains() -> dict[int, dict[str, float]]:
    """Return for each number of vehicles the best of what `measured` gives in some new processes."""
    found = {}
    for n in VEHICLES:
        command = [sys.executable, "-m", "hbbogie.benchmark_train", str(n)]
        outputs = [subprocess.run(command, check=True, capture_output=True, text=True).stdout for _ in range(RUNS)]
        runs = [json.loads(output) for output in outputs]
        found[n] = {step: min(run[step] for run in runs) for step in runs[0]}
    return found


def print_trains(found: dict[int, dict[str, float]]) -> None:
    """Print the table of the page on railway vehicles, one column for each number of vehicles."""
    coordinates = ["coordinates", *(str(17 * n) for n in found)]
    lines = [["vehicles", *map(str, found)], ["---"] * (1 + len(found)), coordinates]
    for step in found[VEHICLES[0]]:
        lines.append([step, *(_number(one[step], step == MEMORY) for one in found.values())])
    for cells in lines:
        print(f"|{'|'.join(cells)}|" if cells[0] == "---" else f"| {' | '.join(cells)} |")


def _number(value: float, whole: bool) -> str:
    """Return a number with two digits, or a whole one."""
    return f"{value:.0f}" if whole or value >= 10 else f"{value:.2f}" if value < 0.1 else f"{value:.1f}"


if __name__ == "__main__":
    print(json.dumps(measured(int(sys.argv[1]))))
