"""Wrong input at the public doors: whatever is given, a sentence says what belongs there."""

from __future__ import annotations

import math
import shlex
import warnings
from functools import partial

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie import model, plot, studies
from hbbogie.commandline import app
from hbbogie.errors import as_path, door, named, pair, several, whole

x, mu = hb.Coordinate("x"), hb.Parameter("mu", 1.0)
OSCILLATOR = x.ddot - mu * (1 - x**2) * x.dot + x
THINGS = {  # of every kind that a call may be given by mistake
    "text": "a text",
    "nothing": None,
    "whole number": 3,
    "number": 2.5,
    "not a number": float("nan"),
    "infinite": float("inf"),
    "truth value": True,
    "list": [1, 2],
    "empty list": [],
    "mapping": {"zzz": 1.0},
    "function": lambda v: v,
    "array": np.zeros(3),
    "matrix": np.eye(2),
    "type": float,
    "complex number": 1 + 2j,
    "MX": ca.MX.sym("m"),
    "coordinate": x,
    "module": math,
    "object": object(),
}


def things(*but: str) -> list[object]:
    assert set(but) <= set(THINGS) and len(THINGS) - len(but) >= 10
    return [pytest.param(thing, id=name) for name, thing in THINGS.items() if name not in but]


@pytest.fixture(scope="module")
def system():
    return hb.load_problem("van_der_pol").van_der_pol()


@pytest.fixture(scope="module")
def equations(system):
    return hb.HarmonicBalance(7).equations(system)


@pytest.fixture(scope="module")
def orbit(equations):
    circle = np.zeros((15, 1))
    circle[1] = 2.0
    guess = hb.Orbit("van der Pol", ("x",), ("",), circle, 1.0, {"mu": 1.0})
    return hb.solve(equations, guess)


@pytest.fixture(scope="module")
def branch(orbit):
    return hb.Branch((orbit, orbit.replace(parameters={"mu": 1.1})), "mu")


@pytest.fixture(scope="module")
def motion(system):
    return hb.simulate(system, {"x": 1.0}, 0.1)


def refused(call, *args, **kwargs):
    """The call is refused by a sentence, and without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(hb.ModelError) as error:
            call(*args, **kwargs)
    text = str(error.value)
    assert text and "<" not in text.replace("low < high", "") and len(text) < 600, text


INTERVAL = (0.5, 1.5)
WITH_SYSTEM = {
    "find_cycles": hb.find_cycles,
    "hopf_points": lambda s: hb.hopf_points(s, "mu", INTERVAL),
    "find_equilibria": lambda s: hb.find_equilibria(s, "mu", INTERVAL),
    "critical_speeds": lambda s: hb.critical_speeds(s, "mu"),
    "chart": lambda s: hb.chart(s, "mu", "mu", INTERVAL),
    "compare": hb.compare,
    "optimise": lambda s: hb.optimise(s, raise_="mu", over={"mu": INTERVAL}),
    "simulate": lambda s: hb.simulate(s, {"x": 1.0}, 1.0),
    "settle": lambda s: hb.motion.settle(s, {"x": 1.0}),
    "around": lambda s: studies.around(s, 0.2),
    "find_basin": lambda s: hb.attraction.find_basin(s, "mu", [1.0], [1.0]),
    "diagram": lambda s: hb.branches.bifurcation_diagram(s, "mu", INTERVAL),
}


@pytest.mark.parametrize("name", WITH_SYSTEM)
@pytest.mark.parametrize("thing", things())
def test_no_system(name, thing):
    refused(WITH_SYSTEM[name], thing)


@pytest.mark.parametrize("thing", things())
def test_no_equations_no_orbit_no_guess(system, equations, orbit, thing):
    refused(hb.solve, thing, orbit)
    refused(hb.trace, thing, orbit, "mu", INTERVAL)
    refused(hb.fold, thing, orbit, "mu")
    refused(hb.solve, equations, thing)
    refused(hb.trace, equations, thing, "mu", INTERVAL)
    refused(hb.fold, equations, thing, "mu")
    for judge in (hb.floquet, hb.verify, hb.stability.hill):
        refused(judge, system, thing)
        refused(judge, thing, orbit)


def test_the_order_of_arguments_is_told(system, equations, orbit):
    swapped = [
        (lambda: hb.floquet(orbit, system), r"floquet\(system, orbit\)"),
        (lambda: hb.verify(orbit, system), r"verify\(system, orbit\)"),
        (lambda: hb.solve(orbit, equations), r"solve\(equations, guess\)"),
        (lambda: hb.trace(orbit, equations, "mu", INTERVAL), r"trace\(equations, start, parameter, interval\)"),
        (lambda: hb.trace(equations, orbit, INTERVAL, "mu"), r"trace\(equations, start, parameter, interval\)"),
        (lambda: hb.trace(equations, "mu", orbit, INTERVAL), r"trace\(equations, start, parameter, interval\)"),
        (lambda: hb.fold(orbit, equations, "mu"), r"fold\(equations, guess\)"),
        (lambda: hb.hopf_points("mu", system, INTERVAL), r"hopf_points\(system, parameter, interval\)"),
        (lambda: hb.hopf_points(system, INTERVAL, "mu"), r"hopf_points\(system, parameter, interval\)"),
        (lambda: hb.find_equilibria(system, INTERVAL, "mu"), r"find_equilibria\(system, parameter, interval\)"),
        (lambda: hb.simulate({"x": 1.0}, system, 1.0), r"simulate\(system, initial, duration\)"),
        (lambda: hb.solve(system, orbit), r"HarmonicBalance\(15\)\.equations\(system\)"),
        (lambda: hb.floquet(system, [orbit]), "Give one of the list"),
        (lambda: hb.find_cycles(hb.load_problem("van_der_pol").van_der_pol), "Call the function"),
        (lambda: hb.hopf_points(system, mu, INTERVAL), "Give its name, 'mu'"),
        (lambda: orbit.amplitude(x), "Give its name, 'x'"),
    ]
    for call, told in swapped:
        with pytest.raises(hb.ModelError, match=told):
            call()


@pytest.mark.parametrize("thing", things("nothing"))
def test_no_parameter_no_coordinate(system, equations, orbit, branch, motion, thing):
    for call in (
        lambda: hb.trace(equations, orbit, thing, INTERVAL),
        lambda: hb.hopf_points(system, thing, INTERVAL),
        lambda: hb.critical_speeds(system, thing),
        lambda: hb.find_cycles(system, parameter=thing),
        lambda: hb.fold(equations, orbit, thing),
        lambda: orbit.amplitude(thing),
        lambda: orbit.first_harmonic(thing),
        lambda: branch.amplitude(thing),
        lambda: motion.amplitude(thing),
        lambda: system.parameter(thing),
        lambda: system.index(thing),
    ):
        refused(call)


@pytest.mark.parametrize("thing", [*things("nothing", "list"), (2.0, 1.0), (1.0, 1.0), (0.0, float("nan")), ("0", "1")])
def test_no_interval(system, equations, orbit, thing):
    refused(hb.trace, equations, orbit, "mu", thing)
    refused(hb.hopf_points, system, "mu", thing)
    refused(hb.find_equilibria, system, "mu", thing)
    refused(hb.find_cycles, system, interval=thing)
    refused(hb.critical_speeds, system, "mu", thing)


@pytest.mark.parametrize("thing", [*things("whole number"), -1, 0.5])
def test_no_number_of_harmonics(system, thing):
    refused(hb.HarmonicBalance, thing)
    refused(hb.find_cycles, system, harmonics=thing)


@pytest.mark.parametrize("thing", things("whole number", "number"))
def test_no_value(system, thing):
    refused(hb.find_cycles, system, mu=thing)
    refused(system.with_parameters, mu=thing)
    refused(hb.Parameter, "a", thing)


@pytest.mark.parametrize("thing", [*things("whole number", "number"), -1.0, 0.0])
def test_no_positive_number(system, equations, orbit, thing):
    refused(hb.simulate, system, {"x": 1.0}, thing)
    refused(hb.find_cycles, system, tolerance=thing)
    refused(hb.solve, equations, orbit, tolerance=thing)
    refused(studies.around, system, thing)
    refused(model.DeadBand, stiffness=thing, gap=-1.0)


@pytest.mark.parametrize("thing", [*things("mapping"), {"zzz": 1.0}, {"x": None}])
def test_no_start(system, thing):
    refused(hb.simulate, system, thing, 1.0)


@pytest.mark.parametrize("thing", things())
def test_no_parts_of_a_system(thing):
    refused(hb.System, "s", thing, [mu], [OSCILLATOR])
    refused(hb.System, "s", [x], thing, [OSCILLATOR, x])
    refused(hb.System, "s", [x], [mu], thing)
    refused(hb.System, "s", [x], [mu], [OSCILLATOR, x], thing)
    refused(hb.System, "s", [thing, x], [mu], [OSCILLATOR])


@pytest.mark.parametrize("thing", [*things("text"), "", "my param", "1a", "lambda", "a-b", "x.y", "é t", "x'"])
def test_no_name(thing):
    refused(hb.Coordinate, thing)
    refused(hb.Parameter, thing, 1.0)


CONDITIONS = {
    "if": lambda: 1.0 if x > 0 else 0.0,
    "if not": lambda: 1.0 if not x.dot else 0.0,
    "max": lambda: max(x - 1, 0),
    "min": lambda: min(x, mu),
    "sorted": lambda: sorted([x, mu]),
    "and": lambda: (x > 0) and (x < 1),
    "or": lambda: (x > 0) or (x < 1),
    "any": lambda: any([x > 0, x < -1]),
    "chained": lambda: -1 < x < 1,
    "while": lambda: [0 for _ in range(1) if x**2 > 1],
}
MATH = "sin cos tanh exp sqrt log atan fabs isnan gamma"
NUMPY = "sin tanh exp sqrt abs sign arctan log"
FUNCTIONS = {
    **{f"math.{n}": partial(getattr(math, n), x.dot) for n in MATH.split()},
    **{f"numpy.{n}": partial(getattr(np, n), x) for n in NUMPY.split()},
    "numpy.maximum": lambda: np.maximum(x, 0),
    "numpy.where": lambda: np.where(x > 0, x, 0),
    "numpy.clip": lambda: np.clip(x, -1, 1),
    "float": lambda: float(x),
    "int": lambda: int(x),
    "range": lambda: range(x),
    "math.copysign": lambda: math.copysign(1.0, x),
    "math.hypot": lambda: math.hypot(x, x.dot),
}
OPERANDS = {name: (lambda t=THINGS[name]: x * t) for name in ("text", "nothing", "function", "MX", "object", "module")}
OPERANDS |= {f"{n} first": (lambda t=THINGS[n]: t + x) for n in ("text", "nothing", "function", "object", "module")}


@pytest.mark.parametrize("name", CONDITIONS)
def test_conditions_become_casadi_functions(name):
    with pytest.raises(hb.ModelError, match=r"casadi\.if_else.*casadi\.fmax"):
        CONDITIONS[name]()


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_math_and_numpy_become_casadi_functions(name):
    with pytest.raises(hb.ModelError, match=r"casadi\."):
        FUNCTIONS[name]()


@pytest.mark.parametrize("name", OPERANDS)
def test_operands_are_expressions_and_numbers(name):
    refused(OPERANDS[name])


@pytest.mark.parametrize("thing", things())
def test_nothing_to_draw(thing):
    one = [plot.branch, plot.frequency, plot.orbit, plot.waveform, plot.spectrum, plot.multipliers, plot.chart]
    for draw in (*one, plot.multipliers_along, plot.time_history, plot.basin, plot.hysteresis, plot.delays):
        refused(draw, thing)


@pytest.mark.parametrize("thing", things())
def test_no_problem_no_job_no_points(thing):
    refused(hb.load_problem, thing)
    refused(hb.sweep, "critical", {"a": [1.0]}, problem=thing, workers=0)
    refused(hb.sweep, "critical", thing, problem="van_der_pol", workers=0)
    refused(studies.grid, {} if isinstance(thing, dict) else thing)
    refused(studies.latin_hypercube, {} if isinstance(thing, dict) else thing, 4)


@pytest.mark.parametrize("thing", [*things("whole number", "nothing"), -1])
def test_no_workers_no_scheduler(thing):
    refused(hb.sweep, "critical", {"a": [1.0]}, problem="bautin", workers=thing)
    if not isinstance(thing, str):
        refused(hb.sweep, "critical", {"a": [1.0]}, problem="bautin", scheduler=thing)


@pytest.mark.parametrize("thing", [*things("text"), "", "no/such/folder/x.nc", "/proc/x.nc"])
def test_no_file(orbit, branch, thing):
    refused(orbit.save, thing)
    refused(branch.save, thing)
    refused(hb.Orbit.load, thing)
    refused(hb.Branch.load, thing)
    refused(studies.export, branch.to_dataset(), thing)
    refused(studies.export, thing, "x.csv")


def test_a_grid_has_an_end():
    many = np.linspace(0.0, 1.0, 10**5)
    with pytest.raises(hb.ModelError, match="1e\\+15 points"):
        studies.grid({"a": many, "b": many, "c": many})


COMMANDS = [
    "run nothing",
    "run yang1995 --set V=abc",
    "run yang1995 --set V",
    "run yang1995 --set V=1 --set V=2",
    "run yang1995 --set V=1e9",
    "run yang1995 --set gravity=7",
    "run yang1995 --figures papers",
    "run yang1995 --output /proc/x",
    "branch van_der_pol --parameter ''",
    "branch van_der_pol --parameter zz",
    "branch van_der_pol --range 1 2 --range 0 3",
    "branch van_der_pol --range 2 1",
    "branch van_der_pol --range nan 1",
    "cycles van_der_pol --parameter ''",
    "plot no_file.nc",
    "plot orbit.nc --quantity size",
    "plot orbit.nc --output orbit.gif",
    "plot orbit.nc --coordinate zz",
    "simulate van_der_pol --start y=1",
    "simulate van_der_pol --duration -1",
    "simulate van_der_pol --method euler",
    "simulate van_der_pol --step 0",
    "compare van_der_pol --methods xx",
    "compare van_der_pol --at a,b",
    "chart yang1995 --over zz 1 2",
    "compare vehicle --at -5",
    "chart vehicle --over lam 0.2 0.2",
    "chart vehicle --over yd1 5 6",
    "chart yang1995 --over lam 2 1",
    "identify van_der_pol",
    "critical bautin --parameter zz",
    "study status no_file.db",
    "study run no_file.toml",
]


@pytest.mark.parametrize("line", COMMANDS)
def test_command_lines_are_refused_before_work_begins(line, orbit, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    orbit.save("orbit.nc")
    result = CliRunner().invoke(app, shlex.split(line))
    told = result.exception if isinstance(result.exception, hb.ModelError) else None  # what main() prints
    assert told or (result.exit_code == 2 and "Error: " in result.output), result.output
    assert "Traceback" not in result.output


@pytest.mark.parametrize("unit", ["", "1"])
def test_no_unit_is_told_of_a_pure_number(unit):
    x, a = hb.Coordinate("x", unit), hb.Parameter("a", 1.0, unit, "share", (0.0, 2.0))
    system = hb.System("spring", [x], [a], [x.ddot + a * x])
    with pytest.raises(hb.ModelError, match=r"got -1; allowed is a finite number from 0 to 2\.$"):
        system.with_parameters(a=-1.0)
    assert repr(a) == "Parameter a = 1: share (0 to 2)"


def test_the_helpers_let_pass_what_belongs_there():
    @door(a=int, b=str)
    def call(a, b=None, *, c=0):
        return a, b, c

    assert call(1) == (1, None, 0) and call(1, "b", c=None) == (1, "b", None) and call(a=2, b="c") == (2, "c", 0)
    assert whole("n", np.int64(3)) == whole("n", 3.0) == 3 and pair("i", [1, 2.0]) == (1.0, 2.0)
    assert named("here", "name", "a", ["a"]) == "a" and several("t", 1, int) == several("t", (1,), int) == [1]
    assert as_path("file", "out").name == "out"
    with pytest.raises(TypeError):
        call()
