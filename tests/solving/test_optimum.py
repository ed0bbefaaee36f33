"""Cycles that are best in some respect: folds, limits and their multipliers, isolated branches."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import ConvergenceError, HarmonicBalance, ModelError
from hbbogie.branches import isolated_branches
from hbbogie.solving import Cycle


def speed(cycle: Cycle):
    return cycle.parameter("V")


def minus_speed(cycle: Cycle):
    return -cycle.parameter("V")


def flange_force(cycle: Cycle):
    return cycle.force("front flange", 32)


def growth(cycle: Cycle):
    return cycle.parameter("mu")


def minus_radius(cycle: Cycle):
    return -cycle.first_harmonic("x")


@pytest.fixture(scope="module")
def lowest(balance, branch):
    return hb.solve(balance, branch.orbits[25], free=["V"], minimise=speed)


class TestFold:
    def test_is_the_smallest_speed(self, balance, branch, lowest):
        """The same number by Newton's method on the conditions of optimality, with the same gradient."""
        fold = hb.fold(balance, branch.folds()[0], "V")
        assert lowest.value == pytest.approx(fold.value, rel=1e-10)
        assert lowest.orbit.omega == pytest.approx(fold.omega, rel=1e-6)
        largest = max(abs(e) for e in fold.elasticities.values())
        values = balance.system.values
        for name, slope in fold.gradient.items():
            assert (lowest.gradient[name] - slope) * values[name] / fold.value == pytest.approx(0.0, abs=1e-6 * largest)

    def test_no_bound_holds_it(self, lowest):
        assert lowest.active == () and lowest.residual < 1e-9 and "Solve_Succeeded" in lowest.status

    def test_bautin(self):
        """mu = r^4 - a r^2 is smallest at r^2 = a / 2: -a^2 / 4 with slope -a / 2 in a."""
        system = hb.load_problem("bautin").bautin(mu=-0.1, a=1.3)
        equations = HarmonicBalance(3).equations(system)
        found = hb.solve(
            equations, hb.find_cycles(system, harmonics=3, stability=False)[-1], free="mu", minimise=growth
        )
        assert found.value == pytest.approx(-(1.3**2) / 4, rel=1e-10)
        assert found.gradient["a"] == pytest.approx(-1.3 / 2, rel=1e-6)
        assert found.gradient["w0"] == pytest.approx(0.0, abs=1e-8)


class TestLimits:
    def test_largest_speed_below_a_flange_force(self, bogie, balance, branch):
        """On the stable branch the force rises with the speed: the limit holds, and its multiplier is dV/dF."""
        start = min(branch.orbits[-15:], key=lambda o: abs(o.parameters["V"] - 110))
        found = [
            hb.solve(balance, start, free=["V"], minimise=minus_speed, subject_to=[(flange_force, -f, f)])
            for f in (29.9e3, 30e3, 30.1e3)
        ]
        middle = found[1]
        assert middle.active == ("limit 1",)
        u = middle.orbit.coefficients[:, 0]
        force = bogie.values["K0"] * (
            np.abs(hb.fourier.synthesis(15, hb.fourier.phases(32)) @ u).max() - bogie.values["y0"]
        )
        assert force == pytest.approx(30e3, rel=1e-6)
        slope = (found[2].value - found[0].value) / 200.0
        assert -np.abs(middle.multipliers[0]).sum() == pytest.approx(slope, rel=1e-3)

    def test_two_free_parameters(self):
        """Largest radius over mu and a with both bounded: r^2 = a / 2 + sqrt(a^2 / 4 + mu) at both upper limits."""
        system = hb.load_problem("bautin").bautin(mu=-0.1, a=1.0)
        equations = HarmonicBalance(3).equations(system)
        start = hb.find_cycles(system, harmonics=3, stability=False)[-1]
        limits = [(growth, None, 0.2), (lambda cycle: cycle.parameter("a"), 0.5, 1.2)]
        found = hb.solve(equations, start, free=["mu", "a"], minimise=minus_radius, subject_to=limits)
        s = 0.6 + np.sqrt(0.36 + 0.2)
        assert -found.value == pytest.approx(np.sqrt(s), rel=1e-8)
        assert found.active == ("limit 1", "limit 2")
        # dr/dmu at fixed a, by the equation of the circle
        assert found.multipliers[0][0] == pytest.approx(1 / (2 * np.sqrt(s)) / (2 * s - 1.2), rel=1e-5)

    def test_expressions(self, balance, branch):
        orbit = branch.orbits[-5]
        z, p = balance.encode(orbit), balance.system.vector(**orbit.parameters)
        import casadi as ca

        symbols = ca.MX.sym("z", balance.size), ca.MX.sym("p", len(p))
        cycle = Cycle(balance, *symbols)
        expressions = [
            cycle.harmonic("q1", 3), cycle.root_mean_square("q1"), cycle.omega, cycle.values("q3", 16),
        ]  # fmt: skip
        third, rms, omega, values = (v.full().ravel() for v in ca.Function("e", symbols, expressions)(z, p))
        assert third[0] == pytest.approx(orbit.spectrum("q1")[3], rel=1e-12)
        assert rms[0] == pytest.approx(
            np.sqrt(np.mean(orbit.q(np.arange(64) / 64 * orbit.period)[:, 0] ** 2)), rel=1e-12
        )
        assert omega[0] == pytest.approx(orbit.omega, rel=1e-12)
        shifted = balance.decode(z, p)
        np.testing.assert_allclose(values, shifted.q(np.arange(16) / 16 * orbit.period)[:, 2], rtol=1e-9, atol=1e-12)


class TestErrors:
    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"free": ["W0"], "minimise": speed}, "W0"),
            ({"free": "V", "minimise": speed, "amplitude": {"q1": 0.01}}, "minimise= combines only with free="),
            ({"minimise": speed}, "minimise= combines only with free="),
            ({"free": "V", "subject_to": [(speed, 1.0, 2.0)]}, "requires minimise="),
            ({"free": ["V", "lam"], "amplitude": {"q1": 0.01}}, "give one name"),
            ({"free": "V", "minimise": speed, "subject_to": [(speed, 2.0, 1.0)]}, "lower 2 and upper 1"),
            ({"free": "V", "minimise": "V"}, "objective is 'V'; give a function"),
            ({"free": "V", "minimise": lambda cycle: None}, "returned None"),
            ({"free": "V", "minimise": speed, "subject_to": [(1, 2)]}, r"limit 1 is \(1, 2\); give \(lambda cycle"),
            ({"free": "V", "minimise": speed, "subject_to": [(1, 2, 3)]}, "limit 1 is"),
            ({"free": "V", "minimise": speed, "subject_to": (speed, 80.0, None)}, "limit 1 is <function speed"),
            ({"free": "V", "minimise": speed, "subject_to": speed}, "limit 1 is <function speed"),
            ({"free": "V", "minimise": speed, "subject_to": [(speed, 80.0, None), (speed, "90", None)]}, "limit 2 is"),
            ({"free": ["V", "V"], "minimise": speed}, "'V' is named twice"),
            ({"free": "V", "minimise": speed, "V": 100.0}, "'V' is named twice"),
            ({"free": "V", "minimise": lambda cycle: cycle.values("q1")}, "must be one number"),
            ({"free": "V", "minimise": lambda cycle: cycle.force("flange")}, "flange"),
            ({"free": "V", "minimise": lambda cycle: cycle.harmonic("q1", 99)}, "up to 15"),
        ],
    )
    def test_wrong_input(self, balance, branch, options, words):
        with pytest.raises(ModelError, match=words):
            hb.solve(balance, branch.orbits[-5], **options)

    def test_limits_that_cannot_be_met(self, balance, branch):
        """No cycle has a speed below the fold."""
        with pytest.raises(ConvergenceError, match="no optimum found"):
            hb.solve(balance, branch.orbits[-5], free="V", minimise=speed, subject_to=[(speed, None, 80.0)])


class TestIsola:
    def test_is_found_and_closes(self):
        """(r^2 - c)^2 + mu^2 = rho^2: its folds are at mu = -rho and rho, where r^2 = c."""
        module = hb.load_problem("isola")
        system = module.isola()
        equations = HarmonicBalance(3).equations(system)
        (hopf,) = hb.hopf_points(system, "mu", module.RANGE)
        main = hb.trace(equations, hopf, "mu", module.RANGE, stability=False)
        assert main.folds() == ()
        (found,) = isolated_branches(equations, "mu", module.RANGE, [main], attempts=20)
        assert "closes on itself" in str(found.ends[0])
        folds = sorted(found.folds(), key=lambda s: s.value)
        assert [s.value for s in folds] == pytest.approx([-0.5, 0.5], abs=1e-8)
        assert [s.orbit.first_harmonic("x") ** 2 for s in folds] == pytest.approx([2.0, 2.0], abs=1e-3)
        r = found.first_harmonic("x")
        np.testing.assert_allclose((r**2 - 2) ** 2 + found.values**2, 0.25, atol=1e-8)

    def test_nothing_more_is_found_where_all_is_known(self):
        system = hb.load_problem("bautin").bautin()
        equations = HarmonicBalance(3).equations(system)
        (hopf,) = hb.hopf_points(system, "mu", (-0.5, 0.3))
        branch = hb.trace(equations, hopf, "mu", (-0.5, 0.3), stability=False)
        assert isolated_branches(equations, "mu", (-0.5, 0.3), [branch], attempts=6) == []

    def test_wrong_input(self, balance):
        with pytest.raises(ModelError, match="attempts=0"):
            isolated_branches(balance, "V", (60.0, 190.0), attempts=0)
