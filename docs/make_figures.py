"""Draw the figures of the documentation anew, into docs/images: ``python docs/make_figures.py`` (a minute)."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import hbbogie as hb
from hbbogie import plot
from hbbogie.model import shipped_problems
from hbbogie.reports import (
    Report,
    basin_of,
    comparison_of,
    conicity_of,
    design_of,
    figures_of_paper,
    identification,
    ramp_of,
    run_of,
)
from hbbogie.studies import load_study, shipped_studies, smallest_critical

IMAGES = Path(__file__).parent / "images"
COLOURS = 256  # of the palette: a third of the size, and no difference to be seen


def van_der_pol_harmonics() -> Figure:
    """Draw the error of the period over the highest harmonic, against the published periods."""
    problem = hb.load_problem("van_der_pol")
    system = problem.van_der_pol()
    figure, ((ax,),) = plot.panels(1, 1)
    with plot.style():
        for published in problem.PUBLISHED[:2]:
            coarse = hb.find_cycles(system, mu=published.mu, harmonics=63, stability=False)[0]
            orders = range(3, 64, 4)
            errors = []
            for H in orders:
                balance = hb.HarmonicBalance(H).equations(system)
                cycle = hb.solve(balance, coarse, tolerance=1e-13, mu=published.mu)
                errors.append(abs(cycle.period / published.period - 1))
            ax.semilogy(orders, np.maximum(errors, 1e-16), "o-", ms=4, label=f"mu = {published.mu:g}")
        ax.set_xlabel("highest harmonic H")
        ax.set_ylabel("relative error of the period")
        ax.legend()
    return figure


def stop_branch() -> Figure:
    """Draw the amplitude of an oscillator between stops over its damping: with contact and, for comparison, without."""
    curves = []
    for k in (10.0, 0.0):
        x = hb.Coordinate("x", "m")
        d, e = hb.Parameter("d", -0.2, "N s/m"), hb.Parameter("e", 0.1, "N s3/m3")
        gap = hb.Parameter("gap", 0.5, "m", bounds=(1e-6, 10.0))
        stop = hb.Element("stop", hb.model.DeadBand(stiffness=k, gap=gap), x)
        system = hb.System("caught", [x], [d, e, gap], [x.ddot + d * x.dot + e * x.dot**3 + x + stop], [stop])
        (hopf,) = hb.hopf_points(system, "d", (-0.3, 0.1))
        balance = hb.HarmonicBalance(31).equations(system)
        branch = hb.trace(balance, hopf, "d", (-0.3, 0.1), longest=0.05)
        curves.append(branch.with_orbits([o.replace(stability=hb.floquet(system, o)) for o in branch.orbits]))
    labels = ["stops at 0.5 m", "no stops"]
    ax = plot.branch(curves, y="x", labels=labels, parameter_label="damping d [N s/m]")
    ax.axhline(0.5, color="#888888", lw=0.8, ls=":")
    ax.set_ylim(-0.03, 1.3)
    return plot.figure_of(ax)


def circuit_branches() -> Figure:
    """Draw symmetric, asymmetric and doubled cycles of the circuit without bias."""
    module = hb.load_problem("circuit")
    circuit, interval = module.circuit(**module.SYMMETRIC), (-0.65, -0.57)
    equations = [hb.HarmonicBalance(H, odd=odd).equations(circuit) for H, odd in ((15, True), (15, False), (30, False))]
    (hopf,) = hb.hopf_points(circuit, "v", interval)
    main = hb.trace(equations[0], hopf, "v", interval)
    fork = next(s for s in main.special if s.kind == "pitchfork")
    broken = hb.trace(equations[1], fork, "v", interval)
    doubling = next(s for s in broken.special if s.kind == "period doubling")
    doubled = hb.trace(equations[2], doubling, "v", interval)
    # both halves have the same peaks: one is enough
    broken = broken.with_orbits(broken.orbits[int(np.argmax(broken.values)) :])
    labels = ["symmetric", "asymmetric", "twice the period"]
    ax = plot.branch([main, broken, doubled], y="x", labels=labels, parameter_label="conductance v [1]")
    return plot.figure_of(ax)


def bogie_basin() -> Figure:
    """Draw the front wheelset at 90 m/s from two starts: one motion dies out, the other hunts."""
    bogie = hb.load_problem("yang1995").bogie(V=90.0)
    figure, axes = plot.panels(2, 1, (6.6, 5.0))
    for ax, q in zip(axes.flat, (0.030, 0.012), strict=True):
        motion = hb.simulate(bogie, {"q1": q, "q3": q}, 12.0)
        plot.time_history(motion, "q1", ax=ax).set_title(f"q1 = q3 = {1e3 * q:g} mm at the start", fontsize=11)
    return figure


def bogie_chart() -> Figure:
    """Draw the critical speeds of the bogie over the conicity, and the width of the region of coexistence."""
    bogie = hb.load_problem("yang1995").bogie()
    found = hb.chart(bogie, "V", "lam", (0.02, 0.3))
    figure, ((top,), (bottom,)) = plot.panels(2, 1, (6.6, 6.4))
    plot.chart(found, top).set_xlabel("")
    plot.coexistence_width(found, bottom)
    return plot.one_legend(figure)


def bogie_cusps() -> Figure:
    """Draw the folds of the bogie over the distance of the contact points, which meet in two cusps."""
    bogie = hb.load_problem("yang1995").bogie()
    ax = plot.chart(hb.chart(bogie, "V", "a", (0.385, 0.425), span=(80.0, 140.0), longest=0.05))
    ax.set_ylim(100.6, 103.6)
    return plot.figure_of(ax)


def attraction() -> Figure:
    """Draw the disturbances of both cycles of the bogie at 90 m/s after each period, and Floquet's law."""
    bogie = hb.load_problem("yang1995").bogie()
    figure, ((ax,),) = plot.panels(1, 1)
    with plot.style():
        for cycle, colour in zip(hb.find_cycles(bogie, V=90.0), ("#D55E00", "#0072B2"), strict=True):
            found = hb.attraction.measure_attraction(bogie, cycle)
            k = np.arange(len(found.shares))
            verdict, size = cycle.stability.verdict, abs(found.predicted)
            ax.semilogy(k, np.abs(found.shares), "o", color=colour, label=f"{verdict} cycle, simulated")
            ax.semilogy(k, size**k, "-", lw=1.2, color=colour, label=f"multiplier {size:.4f} per period")
        ax.set_xlabel("periods")
        ax.set_ylabel("disturbance along the critical mode")
        ax.legend()
    return figure


def bogies() -> Figure:
    """Draw the branches of the simple bogie and of Kaas-Petersen's, with and without flange, and the known cycles."""
    figure, (axes,) = plot.panels(1, 2, (9.6, 4.2))
    for ax, name in zip(axes, ("simple_bogie", "kaas_petersen1986"), strict=True):
        problem, curves = hb.load_problem(name), []
        for flange in (True, False):
            system = problem.SYSTEM(flange=flange)
            (hopf,) = hb.hopf_points(system, "V", problem.RANGE)
            balance = hb.HarmonicBalance(21).equations(system)
            curves.append(hb.trace(balance, hopf, "V", (50.0, 140.0)))
        points = ("computed independently", [c.V for c in problem.CYCLES], [c.q1 for c in problem.CYCLES], "o")
        plot.branch(curves, y="q1", ax=ax, labels=["with flange", "without"], published=[points]).set_title(name)
    return plot.one_legend(figure)


def wheelset() -> Figure:
    """Draw the branch of the wheelset with 1 and with 31 harmonics, and the closed form of one harmonic."""
    problem = hb.load_problem("wheelset")
    system = problem.wheelset()
    (hopf,) = hb.hopf_points(system, "V", (20.0, 100.0))
    balances = [hb.HarmonicBalance(H).equations(system) for H in (1, 31)]
    curves = [hb.trace(b, hopf, "V", (40.0, 60.0), stability=False) for b in balances]
    Y = np.linspace(0.0081, 0.0121, 9)
    V = [problem.first_harmonic_cycle(system.values, float(one))[0] for one in Y]
    closed = [("closed form of one harmonic", V, Y, "o")]
    return plot.figure_of(plot.branch(curves, y="y", labels=["1 harmonic", "31 harmonics"], published=closed))


def train() -> Figure:
    """Draw the Hopf points of trains over the number of vehicles."""
    figure, ((ax,),) = plot.panels(1, 1)
    with plot.style():
        for n in (1, 2, 3, 4):
            found = hb.hopf_points(hb.load_problem("train").train(n), "V", (60.0, 110.0))
            ax.plot([n] * len(found), [h.value for h in found], "o", color="#0072B2", ms=5)
        ax.set_xticks([1, 2, 3, 4])
        ax.set_xlabel("vehicles of the train")
        ax.set_ylabel("Hopf points: speed V [m/s]")
    return figure


def vehicle_attractors() -> Figure:
    """Draw the front wheelset of the vehicle on the branches of its three attractors."""
    problem = hb.load_problem("vehicle")
    return problem.study(problem.vehicle(), lambda message, share: None).figures["attractors_y1"]()


def vehicle_design() -> Figure:
    """Draw the front wheelset of the vehicle on the branch of its lowest fold, before and after its design."""
    problem = hb.load_problem("vehicle_design")
    vehicle = problem.SYSTEM()
    design = hb.optimise(vehicle, interval=problem.RANGE, **problem.design(vehicle))
    branches = [
        hb.trace(point.equations, point.critical[0].orbit, "V", (30.0, 150.0), families=False, stability=False)
        for point in (design.before, design.after)
    ]
    ax = plot.branch(branches, y="y1", labels=["before", "after"], parameter_label="speed V [m/s]")
    return plot.figure_of(ax)


def vehicle_hunting() -> Figure:
    """Draw the share of the designs of the study vehicle_hunting below each lowest critical speed."""
    points, vehicle = load_study(shipped_studies()["vehicle_hunting"]).points, hb.load_problem("vehicle").vehicle()
    systems = [vehicle.with_parameters(**dict(zip(points.names, row, strict=True))) for row in points.values]
    values = [smallest_critical(system, "V", (20.0, 100.0), gradients=False)["critical"] for system in systems]
    ax = plot.shares({"lam, muN": values}, service=50.0, parameter_label="lowest critical speed [m/s]")
    return plot.figure_of(ax)


def conicity() -> Figure:
    """Draw the equivalent conicity of S1002 on UIC60 over the amplitude."""
    return conicity_of("s1002", "uic60").figures["conicity"]()


def basin_report(module: ModuleType, system: hb.System) -> Report:
    """Return the scan along the shape of the unstable cycle."""
    return basin_of(module, system, speeds=41, amplitudes=60)[0]


def released_report(module: ModuleType, system: hb.System) -> Report:
    """Return the scan of both wheelsets released from the same displacement."""
    return basin_of(module, system, along={"q1": 1.0, "q3": 1.0}, speeds=41, amplitudes=60)[0]


def of_page(name: str) -> dict[str, Any]:
    """Return what the code of a page computes, by name."""
    namespace: dict[str, Any] = {"__name__": "page"}
    for block in re.findall(r"```python\n(.*?)```", (IMAGES.parent / name).read_text("utf-8"), re.DOTALL):
        exec(compile(block, name, "exec"), namespace)
    return namespace


def belt_branch() -> Figure:
    """Draw the cycles of the mass on the belt over its speed."""
    ax = plot.branch(of_page("howto/belt.md")["branch"], y="x")
    return plot.figure_of(ax)


def airfoil_branch() -> Figure:
    """Draw the pitch of the airfoil over air speed, and the flutter speed without freeplay."""
    page = of_page("howto/airfoil.md")
    hopf = next(found for found in page["critical"] if found.kind == "hopf")
    start = hb.hopf_points(page["wing"], "U", (hopf.value - 1.0, hopf.value + 1.0))[0]
    ax = plot.branch(hb.trace(hb.exact.Exact().equations(page["wing"]), start, "U", (12.0, 20.0)), y="alpha")
    ax.axvline(page["flutter"].value, color="#888888", lw=0.8, ls=":")
    ax.set_ylim(-0.005, 0.12)
    return plot.figure_of(ax)


def oregonator() -> Figure:
    """Draw both concentrations of the Oregonator over two periods."""
    cycle = of_page("howto/oregonator.md")["cycle"]
    t = np.linspace(0.0, 2 * cycle.period, 3000)
    figure, ((ax,),) = plot.panels(1, 1)
    for values, name in zip(cycle.q(t).T, ("x, bromous acid", "z, oxidised catalyst"), strict=True):
        ax.plot(t, values, label=name)
    ax.set_xlabel("time [1]")
    ax.set_ylabel("concentration [1]")
    ax.legend()
    return figure


def first_picture(name: str) -> Figure:
    """Return the first picture that `hbbogie run` draws of a problem: for the gallery."""
    module = hb.load_problem(name)
    if name in ("vehicle", "vehicle_design"):  # of one system
        return vehicle_attractors()
    if name == "train":  # whose whole job takes minutes: a motion that settles on hunting
        system = module.SYSTEM(V=110.0)
        first = next(c for c in system.coordinate_names if c.startswith("y1"))
        return plot.figure_of(plot.time_history(hb.simulate(system, {first: 0.006}, 6.0), first))
    figures = run_of(module, module.SYSTEM()).figures
    return next(iter(figures.values()))()


def save(figure: Figure, name: str) -> None:
    """Write a figure as a PNG with a palette."""
    path = plot.save(figure, IMAGES / f"{name}.png")
    with Image.open(path) as image:
        small = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(path, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


def main(wanted: list[str]) -> None:
    """Draw the figures whose names are given, or all."""
    IMAGES.mkdir(exist_ok=True)
    own: list[Callable[[], Figure]] = [van_der_pol_harmonics, stop_branch, circuit_branches, bogie_basin]
    own += [attraction, bogie_chart, bogie_cusps, conicity, belt_branch, airfoil_branch, oregonator]
    own += [wheelset, bogies, vehicle_attractors, vehicle_design, vehicle_hunting, train]
    for draw in own:
        if not wanted or draw.__name__ in wanted:
            save(draw(), draw.__name__)
    for name in shipped_problems():
        if not wanted or {"gallery", f"gallery_{name}"} & {*wanted}:
            save(first_picture(name), f"gallery_{name}")
    module = hb.load_problem("yang1995")
    jobs: tuple[tuple[Callable[..., Report], tuple[str, ...]], ...] = (
        (run_of, ("bifurcation", "frequency", "multipliers", "harmonics", "orbits_90", "spectrum_90")),
        (figures_of_paper, tuple(f"figure_{n}" for n in range(2, 7))),
        (comparison_of, ("comparison",)),
        (identification, ("misfit",)),
        (basin_report, ("basin",)),
        (released_report, ("released",)),
        (ramp_of, ("ramp", "ramp_delays")),
    )
    for job, names in jobs:
        chosen = [n for n in names if not wanted or f"yang1995_{n}" in wanted]
        if chosen:
            figures = job(module, module.bogie()).figures
            for name in chosen:
                own_name = "basin" if name == "released" else name
                save(figures[own_name](), f"yang1995_{name}")
    chosen = [n for n in ("bifurcation", "distribution") if not wanted or f"design_{n}" in wanted]
    if chosen:
        redesigned = hb.load_problem("yang1995_design")
        figures = design_of(redesigned, redesigned.SYSTEM(), samples=200).figures
        for name in chosen:
            save(figures[name](), f"design_{name}")


if __name__ == "__main__":
    main(sys.argv[1:])
