"""Cycles of conservative systems: members of families by their amplitude, closed forms, no wrong verdict."""

import casadi as ca
import numpy as np
import pytest
from scipy.special import ellipk

import hbbogie as hb
from hbbogie.branches import cycle_after
from hbbogie.collocation import Collocation
from hbbogie.errors import ModelError
from hbbogie.model import Coordinate, Parameter, System
from hbbogie.stability import hill, verify


@pytest.fixture(scope="module")
def duffing():
    """x'' + k x + x^3 = 0."""
    x, k = Coordinate("x"), Parameter("k", 1.0)
    return System("Duffing", [x], [k], [x.ddot + k * x + x**3])


@pytest.fixture(scope="module")
def prey():
    """Lotka and Volterra: x' = x (a - b y), y' = y (c x - d)."""
    x, y = Coordinate("x", bounds=(0, np.inf)), Coordinate("y", bounds=(0, np.inf))
    a, b, c, d = (Parameter(name, value) for name, value in zip("abcd", (1.0, 1.0, 1.0, 2.0), strict=True))
    return System("prey", [x, y], [a, b, c, d], [x.dot - x * (a - b * y), y.dot - y * (c * x - d)])


@pytest.fixture(scope="module")
def rotating():
    """A pendulum that turns over and over without damping."""
    phi, g = Coordinate("phi", "rad", turn=2 * np.pi), Parameter("g", 1.0)
    return System("pendulum", [phi], [g], [phi.ddot + g * ca.sin(phi)])


def duffing_period(A: float, k: float) -> float:
    """x = A cn(w t | m), w^2 = k + A^2, m = A^2 / (2 w^2)."""
    return float(4 * ellipk(A**2 / 2 / (k + A**2)) / np.sqrt(k + A**2))


class TestAmplitude:
    @pytest.mark.parametrize("size", [0.1, 1.0, 5.0])
    def test_duffing(self, duffing, size):
        guess = cycle_after(duffing, [1.0, 0.0])
        cycle = hb.solve(hb.HarmonicBalance(31).equations(duffing), guess, amplitude={"x": size}, k=2.0)
        assert cycle.first_harmonic("x") == pytest.approx(size, rel=1e-9)
        assert cycle.period == pytest.approx(duffing_period(cycle.amplitude("x"), 2.0), rel=1e-9)

    def test_small_cycles_of_prey_and_predator(self, prey):
        """Their period is 2 pi / sqrt(a d) but for the square of the amplitude; means are d / c and a / b."""
        balance, guess = hb.HarmonicBalance(15).equations(prey), cycle_after(prey, [2.5, 1.2])
        sizes = np.array([0.04, 0.02, 0.01])
        cycles = [hb.solve(balance, guess, amplitude={"x": float(size)}) for size in sizes]
        off = [cycle.period - 2 * np.pi / np.sqrt(2.0) for cycle in cycles]
        np.testing.assert_allclose(np.diff(np.log(off)) / np.diff(np.log(sizes)), 2.0, atol=1e-3)
        np.testing.assert_allclose([cycle.coefficients[0] for cycle in cycles], [[2.0, 1.0]] * 3, rtol=1e-9)

    def test_no_family_no_cycle(self):
        system = hb.load_problem("van_der_pol").van_der_pol(mu=0.5)
        balance = hb.HarmonicBalance(7).equations(system)
        guess = hb.solve(balance, hb.find_cycles(system)[0])
        with pytest.raises(hb.ConvergenceError, match="a parameter must give way"):
            hb.solve(balance, guess, amplitude={"x": 1.5})

    def test_running_coordinate_has_no_amplitude(self, rotating):
        guess = cycle_after(rotating, [0.0, 2.5])
        with pytest.raises(ModelError, match="where coordinates run on"):
            hb.solve(hb.HarmonicBalance(15).equations(rotating), guess, amplitude={"phi": 0.3})


class TestAlongAParameter:
    def test_branch_keeps_the_amplitude(self, duffing):
        guess = cycle_after(duffing, [1.0, 0.0])
        branch = hb.trace(hb.HarmonicBalance(31).equations(duffing), guess, "k", (0.5, 2.0))
        assert (branch.values.min(), branch.values.max()) == (0.5, 2.0)
        for cycle in branch:
            assert cycle.first_harmonic("x") == pytest.approx(guess.first_harmonic("x"), rel=1e-8)
            assert cycle.period == pytest.approx(duffing_period(cycle.amplitude("x"), cycle.parameters["k"]), rel=1e-9)
            assert cycle.verdict == "unknown"

    def test_rotations_keep_their_period(self, rotating):
        """phi'^2 = v^2 - 4 g sin^2(phi/2) with v the speed below: T = 4 K(4 g / v^2) / v."""
        guess = cycle_after(rotating, [0.0, 2.5])
        branch = hb.trace(hb.HarmonicBalance(15).equations(rotating), guess, "g", (0.5, 1.2), stability=False)
        for cycle in [guess, *branch]:
            v = cycle.v(np.linspace(0, cycle.period, 2001)).max()
            assert cycle.omega == pytest.approx(guess.omega, rel=1e-8)
            assert cycle.period == pytest.approx(4 * ellipk(4 * cycle.parameters["g"] / v**2) / v, rel=1e-6)

    def test_damping_ends_the_family(self):
        x, d = Coordinate("x"), Parameter("d", 0.0)
        system = System("damped", [x], [d], [x.ddot + d * x.dot + x + x**3])
        guess = cycle_after(system, [1.0, 0.0])
        branch = hb.trace(hb.HarmonicBalance(15).equations(system), guess, "d", (-0.5, 0.5), max_points=10)
        assert np.abs(branch.values).max() < 1e-9
        for cycle in branch:
            assert cycle.period == pytest.approx(duffing_period(cycle.amplitude("x"), 1.0), rel=1e-6)


def top():
    """Euler's rigid body, with two integrals."""
    w, I = [Coordinate(f"w{i}") for i in (1, 2, 3)], (1.0, 2.0, 3.0)
    k = Parameter("k", 1.0)
    turns = [(1, 2), (2, 0), (0, 1)]
    return System("top", w, [k], [I[i] * w[i].dot - k * (I[a] - I[b]) * w[a] * w[b] for i, (a, b) in enumerate(turns)])


def follower(rate: float):
    """Duffing's oscillator, and a coordinate that follows it or runs away from it."""
    x, z, k = Coordinate("x"), Coordinate("z"), Parameter("k", 1.0)
    return System("follower", [x, z], [k], [x.ddot + k * x + x**3, z.dot + rate * z - x])


class TestVerdict:
    @pytest.mark.parametrize("case", ["duffing", "prey", "rotating", "top"])
    def test_is_unknown_where_all_multipliers_are_1(self, case, request):
        starts = {"duffing": [1.0, 0.0], "prey": [2.5, 1.2], "rotating": [0.0, 2.5], "top": [1.0, 0.2, 0.3]}
        system = top() if case == "top" else request.getfixturevalue(case)
        cycle = cycle_after(system, starts[case])
        for judged in (cycle.stability, hb.floquet(system, cycle), hill(system, cycle)):
            assert judged.verdict == "unknown" and judged.unstable == 0
            assert f"{system.n_states - 1} at 1" in judged.reason
            np.testing.assert_allclose(judged.multipliers, 1.0, atol=1e-3)
        assert not verify(system, cycle).isolated

    def test_collocation_ends_at_the_member_next_to_the_guess(self, duffing):
        guess = hb.solve(
            hb.HarmonicBalance(3).equations(duffing), cycle_after(duffing, [1.0, 0.0]), amplitude={"x": 2.0}
        )
        cycle = hb.solve(Collocation().equations(duffing), guess)
        assert cycle.period == pytest.approx(duffing_period(cycle.amplitude("x"), 1.0), rel=1e-6)
        assert cycle.amplitude("x") == pytest.approx(guess.amplitude("x"), rel=0.1)
        assert cycle.verdict == "unknown" and "not isolated" in cycle.status

    @pytest.mark.parametrize("H", [3, 7, 15])
    def test_is_not_wrong_for_few_harmonics(self, duffing, H):
        guess = cycle_after(duffing, [3.0, 0.0])
        cycle = hb.solve(hb.HarmonicBalance(H).equations(duffing), guess, amplitude={"x": 3.0})
        assert hb.floquet(duffing, cycle).verdict == "unknown"

    def test_says_what_it_is_among_cycles_of_one_level(self):
        system = follower(1.0)
        cycle = cycle_after(system, [1.0, 0.0, 0.5])
        balanced = hb.solve(hb.HarmonicBalance(31).equations(system), cycle, amplitude={"x": 1.1})
        for judged, period in (
            (cycle.stability, cycle.period),
            (hb.floquet(system, balanced), duffing_period(balanced.amplitude("x"), 1.0)),
        ):
            assert judged.verdict == "stable" and "something is conserved" in judged.reason
            assert "2 multipliers at 1 are expected, and found. Judged among motions of one level" in judged.reason
            assert f"the largest {np.exp(-period):.3g}"[:-1] in judged.reason

    def test_a_fold_is_no_family(self):
        """r' = r (mu + r^2 - r^4) turns back at mu = -1/4, r^2 = 1/2: two multipliers are 1, and nothing is kept."""
        x, y, z, mu = Coordinate("x"), Coordinate("y"), Coordinate("z"), Parameter("mu", -0.25)
        r2 = x**2 + y**2
        rate = mu + r2 - r2**2
        system = System("Bautin", [x, y, z], [mu], [x.dot - x * rate + y, y.dot - y * rate - x, z.dot + z - x])
        c = np.array([[0, 0, 0], [1, 0, 0.5], [0, 1, 0.5]]) * np.sqrt(0.5)  # z follows x
        judged = hb.floquet(system, hb.Orbit("Bautin", ("x", "y", "z"), ("",) * 3, c, 1.0, {"mu": -0.25}))
        assert judged.verdict == "unknown" and "family: 2" not in judged.reason
        np.testing.assert_allclose(np.sort(np.abs(judged.multipliers))[1:], 1.0, atol=1e-6)

    def test_unstable_across_the_level(self):
        system = follower(-0.1)
        guess = cycle_after(follower(1.0), [1.0, 0.0, 0.5])
        cycle = hb.solve(hb.HarmonicBalance(15).equations(system), guess)
        judged = hb.floquet(system, cycle)
        assert judged.verdict == "unstable" and judged.unstable == 1
        assert abs(judged.multipliers[0]) == pytest.approx(np.exp(0.1 * cycle.period), rel=1e-6)
