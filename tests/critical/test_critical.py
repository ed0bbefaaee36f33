"""Folds and Hopf points with their gradients."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import crossings
from hbbogie.critical import critical_hessian, hopf_gradient

MASSES = ("Mw", "Mf", "Iwy", "Ify", "Ifr")
DAMPINGS = ("D1", "D2")
STIFFNESSES = ("K0", "K1", "K2", "K3", "K4", "K5", "K6")
CREEP = ("f11", "f22", "f23", "f33")


@pytest.fixture(scope="module")
def criticals(bogie):
    return {c.kind: c for c in hb.critical_speeds(bogie, "V", (60.0, 190.0), harmonics=15)}


def test_both_critical_speeds_of_the_bogie(criticals, branch):
    """PUBLISHED: fold by highest harmonic 15 at 88.763, Hopf point at 90.974 m/s."""
    assert criticals["fold"].value == pytest.approx(88.763, abs=6e-4)
    assert criticals["fold"].extremum == "minimum" and criticals["fold"].curvature > 0
    assert criticals["fold"].value == pytest.approx(branch.folds()[0].value, rel=1e-10)
    assert criticals["hopf"].value == pytest.approx(90.974, abs=6e-4)


@pytest.mark.parametrize("kind", ["fold", "hopf"])
class TestExactIdentities:
    """IDENTITY, up to the accuracy of the solve."""

    def test_the_clearance_has_no_influence(self, criticals, kind):
        """The flange force is homogeneous in the displacement and the clearance."""
        assert abs(criticals[kind].elasticities["y0"]) < 1e-10

    def test_scaling_of_forces(self, criticals, kind):
        """All masses, dampings, stiffnesses and creep coefficients times one number: the same motion."""
        e = criticals[kind].elasticities
        assert abs(sum(e[n] for n in (*MASSES, *DAMPINGS, *STIFFNESSES, *CREEP))) < 1e-10

    def test_scaling_of_time(self, criticals, kind):
        e = criticals[kind].elasticities
        assert 2 * sum(e[n] for n in MASSES) + sum(e[n] for n in DAMPINGS) == pytest.approx(-1, abs=1e-10)

    def test_conicity_and_radius_enter_as_a_ratio(self, criticals, kind):
        e = criticals[kind].elasticities
        assert e["lam"] == pytest.approx(-e["r0"], rel=1e-9)


@pytest.mark.parametrize("name", [p.name for p in hb.load_problem("yang1995").bogie().parameters if p.name != "V"])
def test_gradients_against_solves_at_changed_parameters(bogie, criticals, name):
    """ORDER: central differences of re-solved values, far below 1e-4 of the largest elasticity."""
    h, values = 1e-4, {"fold": [], "hopf": []}
    for sign in (1, -1):
        changed = bogie.with_parameters(**{name: bogie.values[name] * (1 + sign * h)})
        equations = hb.HarmonicBalance(15).equations(changed)
        values["fold"].append(hb.fold(equations, criticals["fold"].orbit, "V").value)
        values["hopf"].append(hb.hopf_points(changed, "V", (60.0, 190.0))[0].value)
    for kind, (plus, minus) in values.items():
        c = criticals[kind]
        assert (plus - minus) / (2 * h) / c.value == pytest.approx(c.elasticities[name], abs=1e-6)


def test_bautin_in_closed_form():
    """SOLVER: fold at -a^2 / 4, so d mu / d a = -a / 2; the Hopf point stays at 0."""
    system = hb.load_problem("bautin").bautin(a=1.3)
    fold, hopf = hb.critical_speeds(system, "mu", (-0.9, 0.5))
    assert (fold.kind, hopf.kind) == ("fold", "hopf")
    assert fold.value == pytest.approx(-(1.3**2) / 4, rel=1e-10)
    assert fold.gradient["a"] == pytest.approx(-0.65, rel=1e-9)
    assert hopf.value == 0.0 and hopf.gradient["a"] == pytest.approx(0.0, abs=1e-12)


def test_hopf_point_whose_equilibrium_only_its_own_parameter_moves():
    """x'' + (a - b x) x' + x = b: the equilibrium is x = b, the damping there a - b^2, the Hopf point b = sqrt(a)."""
    x, a, b = hb.Coordinate("x", "m"), hb.Parameter("a", 2.25), hb.Parameter("b", 1.0)
    system = hb.System("moved", [x], [a, b], [x.ddot + (a - b * x) * x.dot + x - b])
    (hopf,) = hb.hopf_points(system, "b", (1.0, 2.0))
    critical = hopf_gradient(system, hopf)
    assert critical.gradient["a"] == pytest.approx(1 / (2 * 1.5), rel=1e-7)
    second = critical_hessian(hb.HarmonicBalance(1).equations(system), critical, ["a"])
    assert second == pytest.approx(-1 / (4 * 1.5**3), rel=1e-6)


def test_hopf_gradient_where_the_equilibrium_moves():
    """Brusselator: Hopf point at b = 1 + A^2, so db/dA = 2 A; the equilibrium is (A, b / A)."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    b, A = hb.Parameter("b", 2.0), hb.Parameter("A", 1.2)
    system = hb.System("Brusselator", [x, y], [b, A], [x.dot - A + (b + 1) * x - x**2 * y, y.dot - b * x + x**2 * y])
    (hopf,) = hb.hopf_points(system, "b", (1.5, 4.0))
    assert hopf.value == pytest.approx(1 + 1.2**2, rel=1e-9)
    assert hopf_gradient(system, hopf).gradient["A"] == pytest.approx(2.4, rel=1e-7)


def test_a_maximum_is_told_from_a_minimum():
    """An isola: mu^2 + (r^2 - 1)^2 = 0.04, extrema of mu at -0.2 and 0.2 with r = 1."""
    x, y, mu = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("mu", 0.0)
    growth = 0.04 - mu**2 - (x**2 + y**2 - 1) ** 2
    system = hb.System("isola", [x, y], [mu], [x.dot - growth * x + y, y.dot - growth * y - x])
    equations = hb.HarmonicBalance(1).equations(system)
    for value, extremum in ((0.18, "maximum"), (-0.18, "minimum")):
        circle = hb.Orbit("isola", ("x", "y"), ("", ""), np.array([[0, 0], [1.02, 0], [0, 1.02]]), 1.0, {"mu": value})
        found = hb.fold(equations, circle, "mu")
        assert found.extremum == extremum
        assert found.value == pytest.approx(np.sign(value) * 0.2, rel=1e-9)


def test_warm_folds_at_parameters_changed_by_a_fifth(bogie, criticals):
    """Started from the default bogie, and compared with folds found from scratch."""
    rng = np.random.default_rng(5)
    for _ in range(3):
        changed = {n: v * rng.uniform(0.8, 1.2) for n, v in bogie.values.items() if n != "V"}
        system = bogie.with_parameters(**changed)
        scratch = [c for c in hb.critical_speeds(system, "V", (40.0, 200.0), harmonics=15) if c.kind == "fold"]
        if not scratch:
            continue
        warm = hb.fold(hb.HarmonicBalance(15).equations(system), criticals["fold"].orbit, "V")
        assert min(abs(warm.value / c.value - 1) for c in scratch) < 1e-8


def test_without_a_fold_there_is_none():
    """Bautin with a < 0 is supercritical: the radius grows monotonically with mu."""
    system = hb.load_problem("bautin").bautin(a=-1.0, mu=0.1)
    (cycle,) = hb.find_cycles(system, mu=0.1, stability=False)
    with pytest.raises(hb.ConvergenceError, match="What to try"):
        hb.fold(hb.HarmonicBalance(3).equations(system), cycle, "mu")


def test_wrong_input(bogie, balance, branch):
    with pytest.raises(hb.ModelError, match="unknown parameter"):
        hb.fold(balance, branch.folds()[0], "speed")
    rest = hb.HarmonicBalance(0).equations(bogie)
    with pytest.raises(hb.ModelError, match="equilibria"):
        hb.fold(rest, branch.folds()[0], "V")


def test_default_fold_against_shooting(bogie):
    """1e-5 is asked for. By shooting with located contacts both cycles are exact; their frequencies meet at the fold,
    the square of the difference going to zero linearly: 88.764113 m/s, to which a quadratic leads from near by."""
    (fold,) = (c for c in hb.critical_speeds(bogie, "V", (60.0, 190.0), method="mhb") if c.kind == "fold")
    assert fold.orbit.kept == 21
    equations = hb.HarmonicBalance(21).equations(bogie)
    (hopf, *_) = hb.hopf_points(bogie, "V", (88.0, 95.0))
    branch = hb.trace(equations, hopf, "V", (88.0, 95.0), stability=False, longest=0.05)
    speeds, gaps = (88.7643, 88.7644, 88.7646), []
    for V in speeds:
        one, other = (hb.verify(bogie, cycle).orbit.omega for cycle in crossings(equations, branch, V))
        gaps.append((one - other) ** 2)
    exact = np.polyfit(gaps, speeds, 2)[-1]
    assert exact == pytest.approx(88.764113, abs=2e-6)
    assert fold.value == pytest.approx(exact, rel=1e-5)


def test_sensitivity_is_the_product_with_the_jacobian(bogie, balance, branch):
    """One sweep backwards gives what the Jacobian in all parameters gives; sampled forces included."""
    van_der_pol = hb.load_problem("van_der_pol").van_der_pol()
    for equations, orbit in (
        (balance, branch.orbits[-5]),
        (hb.HarmonicBalance(9).equations(van_der_pol), hb.find_cycles(van_der_pol, harmonics=9, stability=False)[0]),
    ):
        z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
        weights = np.random.default_rng(0).standard_normal(equations.size)
        J = equations.derivatives(tuple(range(len(p))))(z, p)[1].full()[:, equations.size :]
        slopes = equations.sensitivity()(z, p, weights).full().ravel()
        np.testing.assert_allclose(slopes, weights @ J, rtol=1e-10, atol=1e-12 * np.abs(J).max())


def test_smooth_fold_of_the_circuit():
    """Published: v = -0.584493, a largest value; its derivatives against folds solved again."""
    module = hb.load_problem("circuit")
    system = module.circuit(**module.BIASED)
    (fold,) = (c for c in hb.critical_speeds(system, "v", (-0.65, -0.55)) if c.kind == "fold")
    assert fold.value == pytest.approx(-0.584493, abs=5e-7) and fold.extremum == "maximum"
    for name in ("b", "g", "r", "a3", "b3"):
        h, values = 1e-5, []
        for sign in (1, -1):
            changed = system.with_parameters(**{name: system.values[name] * (1 + sign * h)})
            values.append(hb.fold(hb.HarmonicBalance(21).equations(changed), fold.orbit, "v").value)
        slope = (values[0] - values[1]) / (2 * h * system.values[name])
        assert fold.gradient[name] == pytest.approx(slope, rel=1e-6)


EXACT = 88.7641131943  # m/s, the fold in closed form


def test_fold_whose_hopf_point_lies_beyond_the_interval(bogie):
    (fold,) = hb.critical_speeds(bogie, "V", (60.0, 90.0))
    assert fold.kind == "fold" and fold.value == pytest.approx(EXACT, abs=1e-3)


@pytest.mark.parametrize("H", [1, 5, 15])
def test_the_error_of_a_fold_bounds_its_distance_from_the_exact_one(bogie, H):
    """However few the harmonics: of them 1 is off by 1 m/s."""
    fold = hb.critical_speeds(bogie, "V", (60.0, 190.0), harmonics=H)[0]
    distance = abs(fold.value - EXACT)
    assert distance <= fold.error <= 1.01 * distance + 1e-7
    assert "the fold in closed form lies at 88.7641131943" in fold.status


def test_fold_next_to_the_hopf_point(bogie):
    """At a conicity of 0.103 the fold lies 2 mm/s below the Hopf point."""
    fold, hopf = hb.critical_speeds(bogie, "V", (40.0, 90.0), lam=0.103)
    assert (fold.kind, hopf.kind) == ("fold", "hopf") and 1e-3 < hopf.value - fold.value < 3e-3
