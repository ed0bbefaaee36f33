"""The files for AUTO-07p: the Fortran statements give what CasADi gives, and AUTO finds the same fold."""

from __future__ import annotations

import math
import re
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie.exchange import statements, to_auto
from hbbogie.reports import export_of
from problems.circuit import circuit
from problems.piecewise import piecewise
from problems.van_der_pol import van_der_pol
from problems.yang1995 import bogie

x, y = ca.SX.sym("x"), ca.SX.sym("y")
EXPRESSIONS = [
    ca.fmax(x, 0) * ca.fmin(y, 1) - ca.fabs(x) ** 2.5,
    ca.if_else(x > y, 1 / x, ca.sqrt(ca.fabs(y))),
    ca.if_else(ca.logic_and(x > 0, y <= 0), ca.atan2(x, y), ca.sign(x)),
    ca.sin(x) ** 2 + ca.tanh(y) + ca.exp(-(x**2)) + ca.log1p(x**2) + ca.expm1(y) + ca.hypot(x, y),
    ca.floor(x) + ca.ceil(y) + ca.fmod(x, 3) + ca.copysign(2, y) + ca.erf(x) + ca.asinh(y),
    ca.if_else(ca.logic_or(ca.logic_not(x > 0), ca.ne(x, y)), 1e-300 * x, -1e22),
]


class Places(dict):
    """An array of Fortran, whose elements are called by round brackets."""

    def __call__(self, *at):
        return self[at]


def evaluated(lines, **given):
    """Read Fortran statements in Python and return the places of the arrays."""
    arrays = {name: Places() for name in ("W", "F", "DFDU", "DFDP")}
    known = dict(vars(math)) | {"merge": lambda a, b, c: a if c else b, "sign": math.copysign, "mod": math.fmod}
    known |= {"aint": math.trunc, "huge": lambda _: math.inf, "min": min, "max": max, "abs": abs}
    known |= {name: Places({(i + 1,): np.float64(v) for i, v in enumerate(values)}) for name, values in given.items()}
    chosen = [True]
    for line in lines:
        text = re.sub(r"(\d)d(-?\d)", r"\1e\2", line).replace("/=", "!=")
        text = text.replace(".and.", " and ").replace(".or.", " or ").strip()
        if text.startswith("if"):
            chosen.append(bool(eval(text.removeprefix("if").removesuffix("then"), known, arrays)))
        elif text == "else":
            chosen[-1] = not chosen[-1]
        elif text == "end if":
            chosen.pop()
        elif all(chosen):
            target, value = text.split(" = ")
            name, at = re.fullmatch(r"(\w+)\(([\d,]+)\)", target).groups()
            arrays[name][tuple(map(int, at.split(",")))] = np.float64(eval(value, known, arrays))
    return arrays


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
@pytest.mark.parametrize("at", [(0.3, -1.7), (-2.4, 0.6), (1.5, 1.5), (0.0, 2.0)], ids=str)
def test_every_operation_means_the_same(expression, at):
    f = ca.Function("f", [x, y], [expression])
    lines, _ = statements(f, [["U(1)"], ["U(2)"]], [[["F(1)"]]])
    with np.errstate(divide="ignore"):  # what is not chosen may be infinite
        found = evaluated(lines, U=at)["F"][(1,)]
    assert found == pytest.approx(float(f(*at)), rel=1e-14, abs=1e-300)


@pytest.mark.parametrize("builder", [bogie, circuit, piecewise, van_der_pol], ids=lambda b: b.__name__)
def test_rates_and_derivatives_are_those_of_the_system(builder):
    system = builder()
    n, names = system.n_states, system.parameter_names
    orbit = hb.Orbit(
        system.name, system.coordinate_names, ("",) * system.n, np.ones((3, system.n)), 2.0, dict(system.values)
    )
    parameter = names[0]
    low, high = system.parameter(parameter).bounds
    span = max(low, -1e3), min(high, 1e3)
    text = next(iter(to_auto(system, orbit, parameter, span).values()))
    func = text.split("subroutine stpnt")[0].splitlines()
    first = next(i for i, line in enumerate(func) if "double precision :: W" in line)
    lines = [
        s
        for line in func[first + 1 :]
        if (s := line.strip()) and not re.match(r"(if \(ijac|DFD. |DFDP\(:|DFDU =|end sub)", s)
    ]
    state = 0.02 * np.random.default_rng(5).standard_normal(n)
    places = {int(k): name for k, name in re.findall(r"PAR\((\d+)\) = \S+  ! (\w+)", text)}
    par = [system.values.get(places.get(k, ""), math.nan) for k in range(1, max(places) + 1)]
    found = evaluated(lines, U=state, PAR=par)
    p = system.vector()
    np.testing.assert_allclose([found["F"][i + 1,] for i in range(n)], system.ode(state, p).full().ravel(), rtol=1e-12)
    A = np.zeros((n, n))
    for (i, j), value in found["DFDU"].items():
        A[i - 1, j - 1] = value
    np.testing.assert_allclose(A, system.ode_jacobian(state, p).full(), rtol=1e-11, atol=1e-12 * np.abs(A).max())
    xs, ps = ca.SX.sym("x", n), ca.SX.sym("p", len(p))
    slopes = ca.Function("s", [xs, ps], [ca.jacobian(system.ode.expand()(xs, ps), ps)])(state, p).full()
    for (i, k), value in found["DFDP"].items():
        assert value == pytest.approx(slopes[i - 1, names.index(places[k])], rel=1e-10)


def test_the_starting_orbit_is_closed():
    system = van_der_pol(mu=1.0)
    cycle = hb.find_cycles(system)[0]
    rows = [line.split() for line in to_auto(system, cycle, "mu", (0.1, 5.0))["van_der_pol.dat"].splitlines()]
    table = np.array(rows, dtype=float)
    assert table[-1, 0] == pytest.approx(6.6632868593, abs=1e-6)  # the period of van der Pol's oscillator at mu = 1
    np.testing.assert_allclose(table[0, 1:], table[-1, 1:], atol=1e-12)


@pytest.mark.parametrize("wrong", [None, "cycle", 3])
def test_what_is_no_cycle_is_refused(wrong):
    with pytest.raises(hb.ModelError):
        to_auto(van_der_pol(), wrong, "mu", (0.1, 5.0))


def test_an_equilibrium_is_refused():
    system = van_der_pol()
    rest = hb.Orbit(system.name, ("x",), ("",), np.zeros((1, 1)), 0.0, dict(system.values))
    with pytest.raises(hb.ModelError, match="give a cycle"):
        to_auto(system, rest, "mu", (0.1, 5.0))


def test_the_command_writes_the_files_and_says_what_to_run(tmp_path):
    module = hb.load_problem("van_der_pol")
    report = export_of(module, van_der_pol(mu=1.0), interval=(0.1, 5.0))
    assert {"van_der_pol.f90", "c.van_der_pol", "van_der_pol.dat"} <= {path.name for path in report.write(tmp_path)}
    assert "`auto van_der_pol.auto`" in report.notes[0]
    assert "UZSTOP = {'mu': [0.1, 5.0]}" in (tmp_path / "c.van_der_pol").read_text()


def test_the_command_says_where_there_is_no_cycle():
    with pytest.raises(hb.ModelError, match=r"no cycle was found at V = 30.*nearest Hopf point.*Give other values"):
        export_of(hb.load_problem("yang1995"), bogie(V=30.0))
    with pytest.raises(hb.ModelError, match="Allowed: auto"):
        export_of(hb.load_problem("van_der_pol"), van_der_pol(), program="matcont")


@pytest.mark.skipif(shutil.which("auto") is None, reason="AUTO-07p is not installed")
def test_auto_finds_the_fold_of_the_bogie(tmp_path):
    system = bogie(V=100.0)
    cycle = next(c for c in hb.find_cycles(system) if c.verdict == "stable")
    for name, text in to_auto(system, cycle, "V", (60.0, 190.0)).items():
        (tmp_path / name).write_text(text)
    done = subprocess.run(["auto", "yang_s_bogie.auto"], cwd=tmp_path, capture_output=True, text=True, check=True)
    folds = [float(value) for value in re.findall(r"LP +\d+ +(\S+)", done.stdout)]
    assert min(folds) == pytest.approx(88.7641131943, abs=1e-3)  # the fold in closed form
