"""Design: closed forms, gradients of what judges a design, optimality, two formulations with one answer."""

from __future__ import annotations

import json
import signal

import matplotlib
import numpy as np
import pytest
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie import plot
from hbbogie.commandline import app
from hbbogie.critical import critical_hessian, hopf_gradient
from hbbogie.design import (
    CriticalValue,
    DampingRatio,
    DesignPoint,
    Expression,
    Limit,
    Peak,
    RootMeanSquare,
    Sample,
    cost_of_change,
    design_point,
    minimise_largest,
    single_level,
)

matplotlib.use("Agg")
RANGE = (60.0, 190.0)
MASSES, DAMPINGS = ("Mw", "Mf", "Iwy", "Ify", "Ifr"), ("D1", "D2")
FORCES = (*MASSES, *DAMPINGS, "K0", "K1", "K2", "K3", "K4", "K5", "K6", "f11", "f22", "f23", "f33")


def two_modes(s: float = 0.5, a: float = 1.0) -> hb.System:
    """Two planar oscillators: a fold at mu = 2 s - a^2 / 4, and a Hopf point of the other at mu = 3 - s.

    The second drives the first and not the other way round, which leaves both values where they are.
    """
    x, y, u, v = (hb.Coordinate(n) for n in "xyuv")
    mu, S, A = hb.Parameter("mu", 0.0), hb.Parameter("s", s), hb.Parameter("a", a)
    r, k = x**2 + y**2, u**2 + v**2
    first, second = mu - 2 * S + A * r - r**2, mu - 3 + S - k
    equations = [
        x.dot - x * first + y - u,
        y.dot - y * first - x,
        u.dot - u * second + 2 * v,
        v.dot - v * second - 2 * u,
    ]
    return hb.System("two modes", [x, y, u, v], [mu, S, A], equations)


# --- the optimiser ----------------------------------------------------------------------------


def test_a_published_minimax():
    """PUBLISHED: problem CB2 of Charalambous and Conn (1978), the largest of three functions is 1.9522245 at least."""

    def evaluate(w, near):
        x, y = 4 * w - 1
        e = np.exp(y - x)
        f = {"a": x**2 + y**4, "b": (2 - x) ** 2 + (2 - y) ** 2, "c": 2 * e}
        slopes = {"a": [2 * x, 4 * y**3], "b": [2 * x - 4, 2 * y - 4], "c": [-2 * e, 2 * e]}
        return Sample(f, {}, {n: 4 * np.array(g) for n, g in slopes.items()}, None)

    found = minimise_largest(evaluate, np.array([0.5, 0.3]))
    assert found.converged and found.sample.largest == pytest.approx(1.9522245, abs=5e-8)
    assert sum(found.weights.values()) == pytest.approx(1.0, abs=1e-9)


def test_a_published_constrained_minimum():
    """PUBLISHED: Rosen and Suzuki (1965): -44 at (0, 1, 2, -1) with multipliers 1, 0, 2."""

    def evaluate(w, near):
        a, b, c, d = x = 10 * w - 5
        f = a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d
        values = {
            "1": x @ x + a - b + c - d - 8,
            "2": a**2 + 2 * b**2 + c**2 + 2 * d**2 - a - d - 10,
            "3": 2 * a**2 + b**2 + c**2 + 2 * a - b - d - 5,
        }
        slopes = {
            "f": [2 * a - 5, 2 * b - 5, 4 * c - 21, 2 * d + 7],
            "1": [2 * a + 1, 2 * b - 1, 2 * c + 1, 2 * d - 1],
            "2": [2 * a - 1, 4 * b, 2 * c, 4 * d - 1],
            "3": [4 * a + 2, 2 * b - 1, 2 * c, -1.0],
        }
        return Sample({"f": f}, values, {n: 10 * np.array(g) for n, g in slopes.items()}, None)

    found = minimise_largest(evaluate, np.full(4, 0.5))
    assert found.converged and found.sample.largest == pytest.approx(-44, abs=1e-7)
    np.testing.assert_allclose(10 * found.x - 5, [0, 1, 2, -1], atol=1e-5)
    assert found.weights["1"] == pytest.approx(1, abs=1e-5) and found.weights["3"] == pytest.approx(2, abs=1e-5)
    assert "2" not in found.weights


def test_contradicting_constraints_are_reported():
    def evaluate(w, near):
        slopes = {"f": np.array([1.0, 0.0]), "c": np.array([-1.0, -1.0])}
        return Sample({"f": float(w[0])}, {"c": float(2.5 - w.sum())}, slopes, None)

    found = minimise_largest(evaluate, np.array([0.5, 0.5]))
    assert not found.converged and found.sample.violation == pytest.approx(0.5, abs=1e-9)
    assert "contradict each other; c, is violated by 0.5" in found.status


# --- closed forms -----------------------------------------------------------------------------


def test_bautin_goes_to_the_bound():
    """SOLVER: the fold at -a^2 / 4 is highest for the smallest a; relaxing that bound gains a / 2 per unit."""
    system = hb.load_problem("bautin").bautin(a=1.5)
    found = hb.optimise(system, raise_="mu", over={"a": (0.5, 2.0)}, interval=(-0.9, 0.5))
    assert found.converged and found.parameters == {"a": 0.5}
    assert found.value == pytest.approx(-0.0625, rel=1e-9) and found.value_before == pytest.approx(-0.5625, rel=1e-9)
    (bound,) = found.active
    assert (bound.kind, bound.side) == ("bound", "lower") and bound.multiplier == pytest.approx(0.25, rel=1e-7)
    one = single_level(found.before, found.over)
    assert one.converged and one.value == pytest.approx(-0.0625, rel=1e-6)


@pytest.mark.parametrize("start", [0.5, 1.7])
def test_fold_and_hopf_point_equally_low(start):
    """SOLVER: 2 s - 1/4 = 3 - s at s = 13/12, a kink; the weights 1/3 and 2/3 balance the slopes 2 and -1."""
    system = two_modes(start)
    found = hb.optimise(system, raise_="mu", over={"s": (0.0, 2.0)}, interval=(-2.0, 5.0), harmonics=3)
    assert found.converged and found.parameters["s"] == pytest.approx(13 / 12, rel=1e-7)
    assert found.value == pytest.approx(3 - 13 / 12, rel=1e-7)
    again = hb.optimise(
        system, raise_="mu", over={"s": (0.0, 2.0)}, interval=(-2.0, 5.0), harmonics=3, start=found.parameters
    )
    assert again.value == pytest.approx(found.value, rel=1e-9) and again.value_before == found.value_before
    assert again.starts[0].parameters == found.parameters and len(again.history) == 1
    weights = {name.split()[0]: w for name, w in found.weights.items()}
    assert weights == pytest.approx({"fold": 1 / 3, "Hopf": 2 / 3}, abs=1e-6)
    one = single_level(found.before, found.over)
    assert one.converged and one.value == pytest.approx(found.value, rel=1e-6)


def test_ctrl_c_keeps_the_best_design():
    """What it has is a design that was solved for, better than the first; before there is one, Ctrl-C is Ctrl-C."""
    system = two_modes(1.7)

    def search(at):
        def progress(message, fraction):
            if message.startswith(at):
                signal.raise_signal(signal.SIGINT)

        over = {"s": (0.0, 2.0)}
        return hb.optimise(system, raise_="mu", over=over, interval=(-2.0, 5.0), harmonics=3, progress=progress)

    found = search("optimising, design 3")
    assert found.interrupted and not found.converged and "interrupted" in found.status
    s = found.parameters["s"]
    assert found.value_before < found.value == pytest.approx(min(2 * s - 0.25, 3 - s), rel=1e-9)
    late = search("optimising, searching for all critical values anew")
    assert late.interrupted and not late.converged and late.value == pytest.approx(3 - 13 / 12, rel=1e-7)
    with pytest.raises(KeyboardInterrupt):
        search("searching for the critical values of the design before")


def test_a_critical_value_above_the_range_is_the_end_of_the_range():
    system = hb.load_problem("bautin").bautin(a=-1.0)
    found = hb.optimise(system, raise_="mu", over={"w0": (0.5, 2.0)}, interval=(-0.9, -0.1))
    assert (
        found.value == -0.1 and found.after.critical == () and found.weights == {"end of the range": pytest.approx(1.0)}
    )


def test_a_fold_to_which_no_hopf_point_leads():
    """r' = r (-s + mu r^2 - r^4) with s > 0: rest is always stable, and the fold lies at mu = 2 sqrt(s)."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    mu, s = hb.Parameter("mu", 1.0), hb.Parameter("s", 0.5)
    r = x**2 + y**2
    rate = -s + mu * r - r**2
    system = hb.System("apart", [x, y], [mu, s], [x.dot - rate * x + y, y.dot - rate * y - x])
    found = hb.optimise(system, raise_="mu", over={"s": (0.2, 0.9)}, interval=(0.5, 3.0), harmonics=3)
    assert found.value_before == pytest.approx(2 * np.sqrt(0.5), rel=1e-8)
    assert found.converged and found.value == pytest.approx(2 * np.sqrt(0.9), rel=1e-8)
    with pytest.raises(hb.ConvergenceError, match=r"has a cycle at mu = 1\.5 already"):
        design_point(system, "mu", (1.5, 3.0), 3)


def test_a_critical_value_below_the_range_is_refused():
    with pytest.raises(hb.ConvergenceError, match=r"unstable already at mu = 0\.1"):
        hb.optimise(hb.load_problem("bautin").bautin(), raise_="mu", over={"a": (0.5, 2.0)}, interval=(0.1, 0.9))


def test_least_change_for_a_required_value():
    """SOLVER: the fold at -a^2 / 4 has to reach -0.16: a = 0.8 and no further."""
    system = hb.load_problem("bautin").bautin(a=1.5)
    found = hb.optimise(
        system,
        raise_="mu",
        over={"a": (0.2, 2.0)},
        interval=(-0.9, 0.5),
        minimise=cost_of_change(system, ["a"]),
        subject_to=[Limit(CriticalValue(), lower=-0.16)],
    )
    assert found.converged and found.feasible and found.parameters["a"] == pytest.approx(0.8, rel=1e-6)
    # d cost / d value = (200 ln(a / 1.5) / a) / (-a / 2), lowered by relaxing the limit
    (limit,) = found.active
    assert limit.multiplier == pytest.approx(-200 * np.log(0.8 / 1.5) / 0.8 / 0.4, rel=1e-4)


def test_an_objective_without_a_value_is_reported():
    """Below the fold there is no cycle, and none whose peak could be lowered."""
    system = hb.load_problem("bautin").bautin(a=1.0)
    with pytest.raises(hb.ConvergenceError, match=r"peak of x at -0\.5 has no value"):
        hb.optimise(system, raise_="mu", over={"a": (0.5, 1.2)}, interval=(-0.9, 0.5), minimise=Peak("x", at=-0.5))


def test_wrong_input():
    system = hb.load_problem("bautin").bautin()
    for wrong, text in (
        ({"over": {}}, "names no parameter"),
        ({"over": {"a": 5.0}}, "pair of bounds"),
        ({"over": ["a"]}, "pair of bounds"),
        ({"over": {"a": (0.5, 2.0)}, "starts": 0}, "from 1"),
        ({"over": {"a": (0.5, 2.0)}, "start": {"w0": 1.0}}, "unknown parameter to choose 'w0'"),
        ({"over": {"b": (0.5, 2.0)}}, "unknown parameter 'b'"),
        ({"over": {"a": (2.0, 0.5)}}, "low < high"),
        ({"over": {"mu": (0.5, 2.0)}}, "another parameter"),
        ({"over": {"a": (0.5, 2.0)}, "subject_to": [Limit(Expression("k", lambda p: p["k"]), upper=1.0)]}, "'k'"),
        ({"over": {"a": (0.5, 2.0)}, "subject_to": [Limit(Peak("z", at=0.1), upper=1.0)]}, "'z'"),
        ({"over": {"a": (0.5, 2.0)}, "maximise": CriticalValue(), "minimise": CriticalValue()}, "both"),
    ):
        with pytest.raises(hb.ModelError, match=text):
            hb.optimise(system, raise_="mu", interval=(-0.9, 0.5), **wrong)
    with pytest.raises(hb.ModelError, match="either"):
        Peak("x")
    with pytest.raises(hb.ModelError, match="positive share"):
        Peak("x", overspeed=0.0)
    with pytest.raises(hb.ModelError, match="give either at="):
        RootMeanSquare("x", at=1.0, overspeed=0.1)
    with pytest.raises(hb.ModelError, match="lower <= upper"):
        Limit(CriticalValue(), lower=1.0, upper=0.0)
    point = design_point(system, "mu", (-0.9, 0.5), 3)
    with pytest.raises(hb.ModelError, match="functions of the parameters"):
        single_level(point, {"a": (0.5, 2.0)}, [Limit(DampingRatio(at=-0.5), lower=0.1)])


@pytest.mark.parametrize("quantity", [DampingRatio(at=-5.0), Peak("q1", at=1e9), DampingRatio(at=0.0)])
def test_values_outside_the_bounds_of_the_parameter(point, quantity):
    with pytest.raises(hb.ModelError, match="outside the bounds"):
        quantity.rows(point)


# --- exact derivatives on the bogie -----------------------------------------------------------


JUDGES = (
    CriticalValue(),
    Expression("yaw stiffness", lambda p: 2 * p["K2"] * p["d1"] ** 2),
    DampingRatio(at=60.0),
    Peak("q1", overspeed=0.1),
    Peak("q3", at=100.0),
    Peak("front flange", overspeed=0.1),
    Peak("frame lateral acceleration", at=100.0),
    RootMeanSquare("frame lateral acceleration", overspeed=0.1),
    RootMeanSquare("q1", at=100.0),
)


@pytest.fixture(scope="module")
def point(bogie):
    return design_point(bogie, "V", RANGE)


@pytest.fixture(scope="module")
def rows(point):
    return [judge.rows(point) for judge in JUDGES]


@pytest.fixture(scope="module")
def logarithmic(bogie, point):
    """Return names, and elasticities with their derivatives by kind of critical point."""
    names = [n for n in bogie.parameter_names if n not in ("V", "W")]
    p, out = np.array([bogie.values[n] for n in names]), {}
    for c in point.critical:
        slope = np.array([c.gradient[n] for n in names]) * p / c.value
        second = critical_hessian(point.equations, c, names) * np.outer(p, p) / c.value
        out[c.kind] = (slope, second + np.diag(slope) - np.outer(slope, slope))
    return names, out


def test_a_design_near_by_has_the_same_critical_values(bogie, point):
    changed = bogie.with_parameters(K1=3.3e6, K2=9e6)
    warm, cold = design_point(changed, "V", RANGE, near=point), design_point(changed, "V", RANGE)
    assert [c.kind for c in warm.critical] == [c.kind for c in cold.critical] == ["fold", "hopf"]
    np.testing.assert_allclose([c.value for c in warm.critical], [c.value for c in cold.critical], rtol=1e-9)


@pytest.mark.parametrize("name", ["K2", "lam"])
def test_gradients_against_differences(bogie, point, rows, name):
    """ORDER: central differences of re-solved values, relative to the largest elasticity of each quantity."""
    h, value, place = 1e-4, bogie.values[name], bogie.parameter_names.index(name)
    sides = [
        design_point(bogie.with_parameters(**{name: value * (1 + d * h)}), "V", RANGE, near=point) for d in (1, -1)
    ]
    for judge, here in zip(JUDGES, rows, strict=True):
        assert here
        for row, a, b in zip(here, *(judge.rows(p) for p in sides), strict=True):
            largest = np.abs(row.gradient * bogie.vector()).max()
            error = (a.value - b.value) / (2 * h) - row.gradient[place] * value
            assert abs(error) <= 1e-6 * max(largest, abs(row.value)), row.name


def test_second_derivatives_of_damping_ratios(bogie, point, rows):
    """ORDER: central differences of the gradients, in logarithms of the parameters."""
    names, h = ["K2", "lam", "D2"], 1e-4
    p, places = np.array([bogie.values[n] for n in names]), [bogie.parameter_names.index(n) for n in names]
    sides = []
    for sign in (1, -1):
        changed = design_point(bogie.with_parameters(lam=bogie.values["lam"] * (1 + sign * h)), "V", RANGE, near=point)
        sides.append([row.gradient[places] for row in DampingRatio(at=60.0).rows(changed)])
    for row, a, b in zip(rows[2], *sides, strict=True):
        exact = row.hessian(names)[1] * p[1] * p
        np.testing.assert_allclose((a - b) / (2 * h) * p, exact, atol=1e-6)


def test_damping_ratio_where_the_equilibrium_moves():
    """Brusselator: the eigenvalues have the trace b - 1 - A^2 and the determinant A^2."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    b, A = hb.Parameter("b", 1.8), hb.Parameter("A", 1.2)
    system = hb.System("Brusselator", [x, y], [b, A], [x.dot - A + (b + 1) * x - x**2 * y, y.dot - b * x + x**2 * y])
    point = DesignPoint(system, hb.HarmonicBalance(3).equations(system), "b", (1.5, 4.0), (), ())
    (row,) = DampingRatio(at=1.8).rows(point)
    assert row.value == pytest.approx((1 + 1.2**2 - 1.8) / (2 * 1.2), rel=1e-9)
    assert row.gradient[1] == pytest.approx((1 - (1 - 1.8) / 1.2**2) / 2, rel=1e-7) and row.hessian is None


@pytest.mark.parametrize("kind", ["fold", "hopf"])
class TestExactHessian:
    """Of a critical value in logarithms of the parameters."""

    def test_the_clearance_has_no_influence(self, logarithmic, kind):
        names, out = logarithmic
        assert np.abs(out[kind][1][names.index("y0")]).max() < 1e-9

    def test_scaling_of_forces(self, logarithmic, kind):
        """IDENTITY: the elasticities sum to zero at all parameters, so each row of their derivatives does."""
        names, out = logarithmic
        rows = [names.index(n) for n in FORCES]
        assert np.abs(out[kind][1][rows].sum(axis=0)).max() < 1e-9

    def test_scaling_of_time(self, logarithmic, kind):
        names, out = logarithmic
        masses, dampings = ([names.index(n) for n in group] for group in (MASSES, DAMPINGS))
        total = 2 * out[kind][1][masses].sum(axis=0) + out[kind][1][dampings].sum(axis=0)
        assert np.abs(total).max() < 1e-9

    def test_against_differences_of_gradients(self, bogie, point, logarithmic, kind):
        names, out = logarithmic
        h, gradients = 1e-4, []
        (c,) = (c for c in point.critical if c.kind == kind)
        for sign in (1, -1):
            changed = bogie.with_parameters(lam=bogie.values["lam"] * (1 + sign * h))
            if kind == "fold":
                near = hb.fold(hb.HarmonicBalance(15).equations(changed), c.orbit, "V")
            else:
                near = hopf_gradient(changed, hb.hopf_points(changed, "V", RANGE)[0])
            gradients.append(np.array([near.elasticities[n] for n in names]))
        difference = (gradients[0] - gradients[1]) / (2 * h)
        np.testing.assert_allclose(out[kind][1][names.index("lam")], difference, atol=1e-6)


# --- the bogie's suspension -------------------------------------------------------------------


@pytest.fixture(scope="module")
def suspension(bogie):
    names = ("K1", "K2", "K3", "K4", "K6", "D2")
    return hb.optimise(
        bogie,
        raise_="V",
        over={n: (0.6 * bogie.values[n], 1.6 * bogie.values[n]) for n in names},
        subject_to=[
            Limit(Expression("yaw stiffness", lambda p: 2 * p["K2"] * p["d1"] ** 2, "N m/rad"), upper=9.2256e6),
            Limit(cost_of_change(bogie, names), upper=50.0),
            Limit(DampingRatio(at=75.0), lower=0.06),
        ],
        interval=RANGE,
    )


def test_the_bogie_is_better_and_keeps_its_limits(suspension):
    assert suspension.converged and suspension.feasible and suspension.value > 1.2 * suspension.value_before
    for name, _, low, high, _, after in suspension.limits:
        assert low - 1e-6 * abs(low) <= after <= high + 1e-6 * abs(high) or not np.isfinite(low + high), name


def test_the_optimum_meets_its_conditions(bogie, suspension):
    """The gradient of the objective is made up of those of what is active, with the multipliers reported."""
    lagrangian = sum(
        w * row.gradient for row in CriticalValue().rows(suspension.after) if (w := suspension.weights.get(row.name))
    )
    size = np.abs(lagrangian * bogie.vector()).max()
    rest = {n: lagrangian[bogie.parameter_names.index(n)] for n in suspension.over}
    for active in suspension.active:
        assert active.multiplier > 0
        if active.kind == "bound":
            rest[active.name] -= active.multiplier * (1 if active.side == "upper" else -1)
            continue
        expression = {
            "yaw stiffness": Expression("yaw stiffness", lambda p: 2 * p["K2"] * p["d1"] ** 2),
            "cost of change": cost_of_change(bogie, list(suspension.over)),
        }[active.name]
        (row,) = expression.rows(suspension.after)
        for n in rest:
            rest[n] -= active.multiplier * row.gradient[bogie.parameter_names.index(n)]
    assert {a.name for a in suspension.active} == {"yaw stiffness", "cost of change", "K6"}
    assert max(abs(g) * bogie.values[n] for n, g in rest.items()) < 1e-5 * size


def test_one_nonlinear_program_agrees(bogie, suspension):
    limits = [
        Limit(Expression("yaw stiffness", lambda p: 2 * p["K2"] * p["d1"] ** 2), upper=9.2256e6),
        Limit(cost_of_change(bogie, list(suspension.over)), upper=50.0),
    ]
    one = single_level(suspension.before, suspension.over, limits)
    assert one.converged and one.value == pytest.approx(suspension.value, rel=1e-6)
    for name, value in suspension.parameters.items():
        assert one.parameters[name] == pytest.approx(value, rel=1e-5)
    for active in suspension.active:
        if active.kind == "limit":
            assert one.multipliers[active.name] == pytest.approx(active.multiplier, rel=1e-4)


def test_tracing_finds_the_same_fold(suspension):
    (hopf,) = hb.hopf_points(suspension.system, "V", RANGE)
    branch = hb.trace(hb.HarmonicBalance(15).equations(suspension.system), hopf, "V", RANGE)
    assert branch.folds()[0].value == pytest.approx(suspension.value, rel=1e-9)


def test_starts_agree_and_failures_do_not_end_the_batch(bogie):
    """From random designs, of which some hunt below the range."""
    over = {"K1": (1.5e6, 5e6), "K2": (4e6, 12e6), "K6": (1e6, 4e6)}
    found = hb.optimise(bogie, raise_="V", over=over, interval=(75.0, 190.0), starts=3, seed=2)
    good = [s.value for s in found.starts if s.feasible]
    assert len(found.starts) == 3 and len(good) >= 2
    np.testing.assert_allclose(good, found.value, rtol=1e-6)
    assert all(s.status for s in found.starts)


OWN = """'''Mine.'''
from scipy import stats
from hbbogie import load_problem
from hbbogie.design import DampingRatio, Limit
from hbbogie.design import Uncertainty

def mine(**values):
    return load_problem("bautin").bautin(**{"a": 5.0, **values})

def design(system):
    return {"over": {"a": (4.0, 6.0)}, "subject_to": [Limit(DampingRatio(at=-3.0), lower=0.2)]}

SYSTEM, PARAMETER, RANGE, SERVICE = mine, "mu", (-9.5, 0.5), -4.5
UNCERTAIN = Uncertainty({"a": stats.norm(1, 0.05)})
"""


def test_command(tmp_path):
    """A user's file, from the command line: tables, both branches, a figure."""
    (tmp_path / "mine.py").write_text(OWN)
    files = tmp_path / "files"
    arguments = ["design", str(tmp_path / "mine.py"), "--samples", "5", "--output", str(files), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["data"]["value"] == pytest.approx(-4.0, rel=1e-8)
    checks = next(t for t in told["tables"] if t["name"] == "checks")["rows"]
    assert checks[0][2] == pytest.approx(-4.0, rel=1e-8)
    assert checks[-2][1] == "dies out" and "settles on a cycle" in checks[-1][1]
    assert {"bifurcation.png", "before.nc", "after.nc", "design.csv", "active.csv"} <= {f.name for f in files.iterdir()}
    with pytest.raises(hb.ModelError, match="one value for each name"):
        plot.gains(["a"], [1.0, 2.0])
    with pytest.raises(hb.ModelError, match="nothing to draw"):
        plot.shares({"after": [np.nan]})
    result = CliRunner().invoke(app, ["design", "bautin", "--output", str(files)])
    assert result.exit_code == 2 and "has no design" in result.stderr
