"""Benchmarks: ``python -m hbbogie.benchmark`` measures the main steps on Yang's bogie and prints them.

``python -m hbbogie.benchmark reliability --count 200`` counts how often random bogies, damaged stores and killed
studies end as they should. ``python -m hbbogie.benchmark train`` measures trains of 1 to 16 vehicles.

Each figure is the best of several single-threaded runs on this machine. Elapsed time is shown beside the processor time
of this process, which is less sensitive to other work on the machine. Parts can be named: ``exact``, ``collocation``,
``balance``, ``smooth``, ``census``, ``explorer``; the last moves sliders in a browser.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import uniform

from hbbogie import (
    Coordinate,
    HarmonicBalance,
    Orbit,
    Parameter,
    System,
    critical_speeds,
    critical_speeds_of,
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
from hbbogie.benchmark_auto import traced_by_auto
from hbbogie.benchmark_explorer import moved
from hbbogie.benchmark_reliability import measure_reliability, print_reliability
from hbbogie.benchmark_train import measure_trains, print_trains
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.method import Collocation
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.solving import collocated
from hbbogie.collocation.special import judged
from hbbogie.collocation.starting import from_motion, from_orbit
from hbbogie.collocation.walk import follow as follow_on_mesh
from hbbogie.design.point import design_point
from hbbogie.design.quantile import SampledQuantile
from hbbogie.design.robust import Uncertainty
from hbbogie.errors import unknown_name
from hbbogie.exact.method import Exact
from hbbogie.exact.multipliers import stabilities
from hbbogie.exact.starting import at_grazing
from hbbogie.exact.walk import Walk, follow

REPEATS = 5
RANDOM = ("Mw", "Mf", "K1", "K2", "K4", "K6", "D2", "lam", "f11")  # varied by 20 % to either side


class Table:
    """The measured times.

    Attributes
    ----------
    rows : list of (str, float, float, str)
        Step, shortest elapsed time [s], shortest processor time [s], remark.
    notes : list of str
        What was not measured, and why.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[str, float, float, str]] = []
        self.notes: list[str] = []

    def add(
        self, what: str, job: Callable[[], Any], repeats: int = REPEATS, remark: Callable[[Any], str] = lambda _: ""
    ) -> Any:
        """Do a job several times, record the shortest times and return the last result."""
        passed, worked, result = float("inf"), float("inf"), None
        for _ in range(repeats):
            start, busy = time.perf_counter(), time.process_time()
            result = job()
            passed, worked = min(passed, time.perf_counter() - start), min(worked, time.process_time() - busy)
        self.rows.append((what, passed, worked, remark(result)))
        return result


def measure(table: Table, H: int = 15) -> None:
    """Measure the steps that use harmonic balance, and those that need no method."""
    add = table.add
    command = [sys.executable, "-c", "import hbbogie"]
    add("import hbbogie, in a new process", lambda: subprocess.run(command, check=True), 3)
    version = [sys.executable, "-m", "hbbogie", "--version"]
    add("hbbogie --version, from shell", lambda: subprocess.run(version, check=True, capture_output=True), 3)
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
        f"the same with multipliers and special points, H = {H}",
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


def measure_exact(table: Table, designs: int = 1000) -> None:
    """Measure the steps that use cycles in closed form."""
    system = load_problem("yang1995").bogie()
    (hopf,) = hopf_points(system, "V", (60.0, 190.0))

    def branch() -> Walk:
        walk = follow(at_grazing(system, hopf), (60.0, 190.0))
        for point in walk.points:
            stabilities(point.closing, point.y[None], point.at)
        return walk

    def remark(walk: Walk) -> str:
        special = [f"{p.kind} {p.value:.6f}" for p in walk.points if p.kind in ("fold", "grazing")]
        return f"{len(walk.points)} points, {', '.join(special)}"

    table.add("branch in closed form, multipliers, fold and grazings", branch, remark=remark)
    span = (10.0, 250.0)
    table.add(
        "critical speeds in closed form, one design from nothing",
        lambda: critical_speeds_of(system, {"lam": [0.05]}, interval=span),
        remark=lambda found: f"fold {found.fold[0]:.6f}, hopf {found.hopf[0]:.6f} m/s, gradients",
    )
    rng = np.random.default_rng(0)
    random = {name: system.values[name] * (1 + 0.2 * rng.uniform(-1, 1, designs)) for name in RANDOM}
    table.add(
        f"the same for {designs} random bogies in a batch",
        lambda: critical_speeds_of(system, random, interval=span),
        1,
        lambda found: (
            f"{np.isfinite(found.fold).sum()} folds, {found.failed.sum()} unknown, "
            f"{sum('following' in s or 'no fold' in s for s in found.status)} followed one by one"
        ),
    )
    softer = {"lam": 3.0 * system.values["lam"] * (1 + 0.02 * rng.uniform(-1, 1, 100))}
    table.add(
        "the same for 100 bogies of a high conicity, without a fold",
        lambda: critical_speeds_of(system, softer, interval=span),
        1,
        lambda found: f"{np.isnan(found.fold).sum()} without a fold, {found.complete.sum()} followed one by one",
    )
    scatter = Uncertainty({name: uniform(0.8, 0.4) for name in RANDOM})
    point, quantile = design_point(system, "V", span), SampledQuantile(scatter, 0.05, 10_000, unit="m/s")
    table.add(
        "a step of robust design: 5 % quantile of 10000 random bogies, with its gradient",
        lambda: quantile.rows(point),
        1,
        lambda rows: f"{rows[0].value:.3f} m/s",
    )


def measure_smooth(table: Table, H: int = 15) -> None:
    """Measure branches of harmonic balance of two smooth systems, without and with multipliers at each point."""
    oscillator = load_problem("van_der_pol").van_der_pol(mu=1.0)
    bogie = load_problem("kaas_petersen1986").bogie(flange=False)
    (hopf,) = hopf_points(bogie, "V", (50.0, 140.0))
    first = find_cycles(oscillator, mu=1.0, stability=False)[0]
    cases: list[tuple[str, System, Any, str, tuple[float, float]]] = [
        ("van der Pol from mu = 0.5 to 3", oscillator, first, "mu", (0.5, 3.0)),
        ("Kaas-Petersen's bogie without flanges, 50 to 140 m/s", bogie, hopf, "V", (50.0, 140.0)),
    ]
    for name, system, start, parameter, span in cases:
        equations = HarmonicBalance(H).equations(system)
        for stability in (False, True):
            table.add(
                f"{name}, H = {H}{', with multipliers' if stability else ''}",
                partial(trace, equations, start, parameter, span, stability=stability),
                remark=lambda b: f"{len(b)} points, {sum(o.verdict == 'unknown' for o in b.orbits)} unknown",
            )


def measure_collocation(table: Table) -> None:
    """Measure collocation, and harmonic balance beside it, on van der Pol's oscillator."""
    builder = load_problem("van_der_pol").van_der_pol
    steep = builder(mu=1000.0)
    table.add(
        "van der Pol, mu = 1000, from a motion, by collocation",
        lambda: collocated(steep, from_motion(steep, [2.0, 0.0])),
        3,
        lambda cycle: f"T = {cycle.period:.6f}, {len(cycle.values)} intervals",
    )
    system = builder(mu=1.0)
    orbit = collocated(system, from_motion(system, [2.0, 0.0])).orbit()
    _compare(table, "branch from mu = 0.5 to 5", system, orbit, "mu", (0.5, 5.0), 63)
    rolling = load_problem("kaas_petersen1986").bogie(flange=False)
    (hopf,) = hopf_points(rolling, "V", (60.0, 80.0))
    begin = trace(HarmonicBalance(15).equations(rolling), hopf, "V", (66.0, 80.0), stability=False).orbits[-1]
    _compare(table, "branch of a smooth bogie, 14 states,", rolling, begin, "V", (60.0, 70.0), 15)
    bogie = load_problem("yang1995").bogie()
    (hopf,) = hopf_points(bogie, "V", (60.0, 100.0))
    (near,) = trace(Exact().equations(bogie), hopf, "V", (60.0, 100.0)).folds()
    _compare(table, "branch of the bogie with contacts", bogie, near.orbit, "V", (87.0, 100.0), 15)
    on_mesh = Collocation().equations(bogie)
    table.add(
        "fold of the bogie with its gradient, by collocation",
        lambda: fold(on_mesh, near, "V"),
        1,
        lambda found: f"{found.value:.9f} m/s",
    )


def _compare(
    table: Table, what: str, system: System, start: Orbit, parameter: str, span: tuple[float, float], H: int
) -> None:
    """Measure a branch with multipliers by collocation, and by harmonic balance beside it."""

    def branch() -> list[CollocatedCycle]:
        followed = follow_on_mesh(from_orbit(system, start), Rates(system, parameter), span)
        return [judged(curve, point) for curve, point in followed.points()]

    table.add(
        f"{what} with multipliers, by collocation",
        branch,
        3,
        lambda cycles: f"{len(cycles)} points, error of T {max(c.period_error for c in cycles):.0e}",
    )
    balance = HarmonicBalance(H).equations(system)
    table.add(
        f"the same by harmonic balance, H = {H}",
        lambda: trace(balance, start, parameter, span),
        3,
        lambda b: f"{len(b)} points, tail {max(o.tail for o in b.orbits):.0e}",
    )


def measure_census(table: Table) -> None:
    """Measure the search for all cycles of two smooth systems with slow and fast motions, from nothing."""
    x, y, z = Coordinate("x"), Coordinate("y"), Coordinate("z")
    f, current, q = Parameter("f", 1.0), Parameter("I", 2.0), 0.002
    steep = [0.04 * x.dot - (x * (1 - x) - f * z * (x - q) / (x + q)), z.dot - (x - z)]
    spikes = [x.dot - (y - x**3 + 3 * x**2 - z + current), y.dot - (1 - 5 * x**2 - y)]
    bursts = System("Hindmarsh-Rose, I = 2", [x, y, z], [current], [*spikes, z.dot - 0.006 * (4 * (x + 1.6) - z)])
    for system in (System("Oregonator, f = 1", [x, z], [f], steep), bursts):
        table.add(f"all cycles of {system.name}", partial(find_cycles, system), 1, lambda c: f"T = {c[0].period:.9g}")


def measure_auto(table: Table) -> None:
    """Measure AUTO-07p on the bogie's branch, from 190 m/s around the fold, by its own clock."""
    what = "branch by AUTO-07p, 60 intervals, with multipliers"
    if (found := traced_by_auto()) is None:
        table.notes.append(f"{what}: left out, since `auto` is not on the path")
        return
    spent, points, lowest = found
    table.rows.append((what, spent, spent, f"{points} points, fold {lowest:.4f} m/s"))


def measure_explorer(table: Table, moves: int = 50) -> None:
    """Measure random moves of sliders in Chromium, from the slider to the drawn diagram; the median counts."""
    if found := moved(moves):
        passed, worked = found
        remark = f"{len(passed)} moves, nine of ten within {1e3 * np.quantile(passed, 0.9):.0f} ms"
        what = "explorer: from slider to drawn diagram, median in a browser"
        table.rows.append((what, float(np.median(passed)), worked, remark))


def _peak_memory() -> float:
    """Return the largest resident memory of the processes started so far [MB]."""
    import resource  # not on Windows

    kilobytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return kilobytes / (1e6 if sys.platform == "darwin" else 1e3)


def main(arguments: Sequence[str] = ()) -> None:
    """Measure and print what the arguments of the command line ask for: all parts, those named, or reliability."""
    known = {"exact": measure_exact, "collocation": measure_collocation, "balance": measure, "census": measure_census}
    known |= {"smooth": measure_smooth, "auto": measure_auto, "explorer": measure_explorer}
    parser = argparse.ArgumentParser(prog="python -m hbbogie.benchmark", description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"{', '.join(known)}; or reliability; or train")
    parser.add_argument("--count", type=int, default=200, help="random bogies and flipped bits of reliability")
    given = parser.parse_args(arguments)
    if given.parts == ["reliability"]:
        if given.count < 1:
            parser.error(f"--count {given.count}: give a whole number, 1 or more")
        print_reliability(measure_reliability(given.count))
        return
    if given.parts == ["train"]:
        print_trains(measure_trains())
        return
    for part in given.parts:
        if part not in known:
            parser.error(unknown_name("part", part, [*known, "reliability", "train"]))
    table = Table()
    for part in given.parts or known:
        known[part](table)
    width = max(len(what) for what, *_ in table.rows)
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    print(f"{platform.machine()}, {os.cpu_count()} processors{load}; times in ms")
    print(f"{'':<{width}}  {'passed':>10}  {'worked':>10}")
    for what, passed, worked, remark in table.rows:
        print(f"{what:<{width}}  {1e3 * passed:10.1f}  {1e3 * worked:10.1f}  {remark}")
    for note in table.notes:
        print(note)


if __name__ == "__main__":
    main(sys.argv[1:])
