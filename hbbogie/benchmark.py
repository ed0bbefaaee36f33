"""Benchmarks: ``python -m hbbogie.benchmark`` measures the main steps on Yang's bogie and prints them.

Each figure is the best of several runs on this machine, single-threaded; the first, building run stands apart.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

from hbbogie import (
    HarmonicBalance,
    critical_speeds,
    find_cycles,
    floquet,
    fold,
    hopf_points,
    load_problem,
    simulate,
    solve,
    trace,
    verify,
)

REPEATS = 5


def timed(job: Callable[[], Any], repeats: int = REPEATS) -> tuple[float, Any]:
    """Return the shortest time of the runs [s] and the last result."""
    best, result = float("inf"), None
    for _ in range(repeats):
        start = time.perf_counter()
        result = job()
        best = min(best, time.perf_counter() - start)
    return best, result


def measure(H: int = 15) -> list[tuple[str, float, str]]:
    """Return what was measured: (what, seconds, remark)."""
    rows: list[tuple[str, float, str]] = []

    def add(
        what: str, job: Callable[[], Any], repeats: int = REPEATS, remark: Callable[[Any], str] = lambda _: ""
    ) -> Any:
        seconds, result = timed(job, repeats)
        rows.append((what, seconds, remark(result)))
        return result

    command = [sys.executable, "-c", "import hbbogie"]
    add("import hbbogie, in a new process", lambda: subprocess.run(command, check=True), 3)
    builder = load_problem("yang1995").bogie

    def build() -> Any:
        fresh = HarmonicBalance(H).equations(builder())
        fresh.derivatives((0,))
        return fresh

    equations = add(f"build system and equations, H = {H}, with derivatives", build, 3)
    system = equations.system
    hopf = add("Hopf points from 60 to 190 m/s", lambda: hopf_points(system, "V", (60.0, 190.0)))
    branch = add(
        "branch from grazing around the fold to 190 m/s",
        lambda: trace(equations, hopf[0], "V", (60.0, 190.0), stability=False),
        remark=lambda b: f"{len(b)} points, fold at {b.folds()[0].value:.5f} m/s",
    )
    add(
        "the same with multipliers and special points",
        lambda: trace(equations, hopf[0], "V", (60.0, 190.0)),
        remark=lambda b: ", ".join(f"{s.kind} {s.value:.4f}" for s in b.special),
    )
    add(
        "critical speeds from 20 to 300 m/s, from nothing",
        lambda: critical_speeds(builder(), "V", (20.0, 300.0)),
        3,
        lambda found: ", ".join(f"{c.kind} {c.value:.4f}" for c in found),
    )
    lowest = min(branch.orbits, key=lambda orbit: orbit.parameters["V"])
    add("warm fold with its gradient", lambda: fold(equations, lowest, "V"), 10, lambda c: f"{c.value:.5f} m/s")
    near = branch.orbits[-5]
    V = near.parameters["V"]
    equations.derivatives(())
    add("warm solve, 1 m/s away, Newton", lambda: solve(equations, near, V=V + 1.0), 20)
    solve(equations, near, V=V, method="ipopt")
    add("warm solve, 1 m/s away, IPOPT", lambda: solve(equations, near, V=V + 1.0, method="ipopt"), 20)
    add("Floquet multipliers of a cycle", lambda: floquet(system, near), 10, lambda s: s.verdict)
    add("the same cycle verified by shooting", lambda: verify(system, near), 3, lambda v: v.status)
    add("both cycles at 90 m/s with stability", lambda: find_cycles(system, V=90.0), 3, lambda c: f"{len(c)} cycles")
    start = {"q1": 0.03, "q3": 0.03}
    add("60 s of motion, RK4 with 1 ms", lambda: simulate(system, start, 60.0), 3)
    add("60 s of motion, CVODES", lambda: simulate(system, start, 60.0, method="cvodes"), 1)
    with tempfile.TemporaryDirectory() as folder:
        job = [sys.executable, "-m", "hbbogie", "run", "yang1995", "--output", folder]
        add(
            "hbbogie run yang1995, from shell to figures",
            lambda: subprocess.run(job, check=True, capture_output=True),
            1,
            lambda _: f"at most {_peak_memory():.0f} MB",
        )
    return rows


def _peak_memory() -> float:
    """Return the largest resident memory of the processes started so far [MB]."""
    import resource  # not on Windows

    kilobytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return kilobytes / (1e6 if sys.platform == "darwin" else 1e3)


def main() -> None:
    """Measure and print."""
    rows = measure()
    width = max(len(what) for what, _, _ in rows)
    for what, seconds, remark in rows:
        print(f"{what:<{width}}  {1e3 * seconds:10.1f} ms  {remark}")


if __name__ == "__main__":
    main()
