"""Hopf points, branches, folds, all cycles at a value."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import ModelError


class TestHopfPoints:
    def test_linear_critical_speed_of_the_bogie(self, bogie):
        """90.974 m/s and 26.9485 rad/s; the paper prints 91.00 and 26.96 with its own creep coefficients."""
        first = hb.hopf_points(bogie, "V", (50.0, 200.0))[0]
        assert first.value == pytest.approx(90.974, abs=5e-4)
        assert first.omega == pytest.approx(26.9485, abs=5e-5)
        assert "gains" in first.status

    def test_all_are_found(self, bogie):
        """Between 1 and 300 m/s the pairs with growing oscillation change in number exactly at the points found."""
        points = hb.hopf_points(bogie, "V", (1.0, 300.0))
        edges = [1.0, *(h.value for h in points), 300.0]
        counts = []
        for a, b in pairwise(edges):
            middle = bogie.ode_jacobian(np.zeros(14), bogie.vector(V=(a + b) / 2)).full()
            eigenvalues = np.linalg.eigvals(middle)
            counts.append(int(((eigenvalues.real > 0) & (eigenvalues.imag > 0)).sum()))
        assert counts == list(range(len(points) + 1))

    def test_the_mode_solves_the_linear_equations(self, bogie):
        hopf = hb.hopf_points(bogie, "V", (60.0, 190.0))[0]
        c, s = hopf.orbit.coefficients[1:]
        q, iw = c - 1j * s, 1j * hopf.omega
        V = {"V": hopf.value}
        r = (bogie.mass(**V) * iw**2 + bogie.damping(**V) * iw + bogie.stiffness(**V)) @ q
        assert np.abs(r).max() < 1e-8 * np.abs(bogie.stiffness(**V) @ q).max()

    def test_a_double_crossing_between_two_samples_is_found(self):
        """Damping (m - 0.5)^2 - 1e-8: crosses zero at 0.5 -+ 1e-4, far closer than the grid."""
        x, m = hb.Coordinate("x"), hb.Parameter("m", 0.3)
        system = hb.System("s", [x], [m], [x.ddot + ((m - 0.5) ** 2 - 1e-8) * x.dot + x])
        values = [h.value for h in hb.hopf_points(system, "m", (0.0, 1.03))]
        np.testing.assert_allclose(values, [0.5 - 1e-4, 0.5 + 1e-4], rtol=1e-6)

    def test_at_a_moving_equilibrium(self):
        """Brusselator with A = 1: rest at (1, b), Hopf point at b = 2, omega = 1."""
        x, y, b = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("b", 1.5)
        system = hb.System("Brusselator", [x, y], [b], [x.dot - 1 + (b + 1) * x - x**2 * y, y.dot - b * x + x**2 * y])
        (hopf,) = hb.hopf_points(system, "b", (1.2, 4.0))
        assert hopf.value == pytest.approx(2.0, abs=1e-9)
        assert hopf.omega == pytest.approx(1.0, abs=1e-8)
        np.testing.assert_allclose(hopf.orbit.coefficients[0], [1.0, 2.0], atol=1e-9)

    @pytest.mark.parametrize("interval", [(100.0, 50.0), (90.0, 90.0), (500.0, 600.0), (float("nan"), 90.0)])
    def test_empty_intervals(self, bogie, interval):
        with pytest.raises(ModelError, match="low < high"):
            hb.hopf_points(bogie, "V", interval)


class TestBogieBranch:
    def test_runs_from_grazing_around_the_fold_to_the_end(self, branch):
        assert branch.orbits[0].amplitude("q1") == pytest.approx(0.0091, rel=1e-6)
        assert branch.values[0] == pytest.approx(90.974, abs=5e-4)
        assert branch.values[-1] == 190.0
        assert "Hopf point" in str(branch.ends[0]) and "end of the interval" in str(branch.ends[1])

    @pytest.mark.parametrize(("H", "fold"), [(1, 87.754), (3, 88.427), (5, 88.642), (9, 88.760), (15, 88.763)])
    def test_fold_by_highest_harmonic(self, bogie, H, fold):
        """PUBLISHED: half a unit of the last digit of independently computed folds."""
        equations = hb.HarmonicBalance(H).equations(bogie)
        hopf = hb.hopf_points(bogie, "V", (60.0, 190.0))[0]
        (found,) = hb.trace(equations, hopf, "V", (60.0, 120.0)).folds()
        assert found.value == pytest.approx(fold, abs=6e-4)

    def test_fold_is_the_lowest_point_of_the_branch(self, branch):
        (fold,) = branch.folds()
        assert fold.value == pytest.approx(branch.values.min(), rel=1e-12)
        assert fold.interval[0] <= fold.value <= fold.interval[1]

    def test_at_the_fold_the_rear_wheelset_just_touches(self, branch):
        """Its peak is about 1.001 times the clearance there."""
        (fold,) = branch.folds()
        assert fold.orbit.amplitude("q3") / 0.0091 == pytest.approx(1.00101, abs=5e-4)

    def test_every_point_solves_the_equations(self, branch):
        assert max(o.residual for o in branch.orbits) < 1e-9

    def test_from_the_middle_in_both_directions(self, balance, branch):
        whole = hb.trace(balance, branch.orbits[20], "V", (60.0, 190.0))
        assert "first harmonic vanishes" in str(whole.ends[0])
        assert whole.values[-1] == 190.0
        (fold,) = whole.folds()
        assert fold.value == pytest.approx(branch.folds()[0].value, rel=1e-8)

    def test_short_intervals_end_on_their_ends(self, balance, branch):
        piece = hb.trace(balance, branch.orbits[-3], "V", (140.0, 185.0))
        assert sorted((piece.values[0], piece.values[-1])) == [140.0, 185.0]

    def test_saving_and_loading(self, branch, tmp_path):
        path = tmp_path / "branch.nc"
        branch.save(path)
        twin = hb.Branch.load(path)
        np.testing.assert_array_equal(twin.values, branch.values)
        np.testing.assert_array_equal(twin.orbits[7].coefficients, branch.orbits[7].coefficients)
        assert twin.folds()[0].value == branch.folds()[0].value
        assert twin.ends == branch.ends
        assert twin.orbits[0].parameters == branch.orbits[0].parameters

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (("Vx", (60.0, 190.0)), "unknown parameter 'Vx'"),
            (("V", (190.0, 60.0)), "low < high"),
            (("V", (300.0, 350.0)), "outside the interval"),
        ],
    )
    def test_wrong_input(self, balance, branch, arguments, message):
        with pytest.raises(ModelError, match=message):
            hb.trace(balance, branch.orbits[-1], *arguments)

    def test_equilibria_are_no_cycles(self, bogie, branch):
        with pytest.raises(ModelError, match="those of equilibria"):
            hb.trace(hb.HarmonicBalance(0).equations(bogie), branch.orbits[-1], "V", (60.0, 190.0))


def test_bautin_branch_in_closed_form():
    """SOLVER: r^2 = (a +- sqrt(a^2 + 4 mu)) / 2 on the branch, fold at mu = -a^2 / 4."""
    system = hb.load_problem("bautin").bautin(a=1.3)
    hopf = hb.hopf_points(system, "mu", (-0.9, 0.5))[0]
    assert hopf.value == pytest.approx(0.0, abs=1e-9)
    branch = hb.trace(hb.HarmonicBalance(3).equations(system), hopf, "mu", (-0.9, 0.5))
    (fold,) = branch.folds()
    assert fold.value == pytest.approx(-(1.3**2) / 4, rel=1e-9)
    s = branch.amplitude("x") ** 2
    np.testing.assert_allclose(branch.values + 1.3 * s - s**2, 0, atol=1e-9)


def test_a_closed_branch_is_noticed():
    """An isola: (mu^2 + (r^2 - 1)^2 - 0.04) r = 0 in the radius, a circle in (mu, r^2)."""
    x, y, mu = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("mu", 0.0)
    s = x**2 + y**2
    growth = 0.04 - mu**2 - (s - 1) ** 2
    system = hb.System("isola", [x, y], [mu], [x.dot - growth * x + y, y.dot - growth * y - x])
    equations = hb.HarmonicBalance(1).equations(system)
    r = np.sqrt(1.2)
    start = hb.Orbit("isola", ("x", "y"), ("", ""), np.array([[0, 0], [r, 0], [0, r]]), 1.0, {"mu": 0.0})
    branch = hb.trace(equations, start, "mu", (-1.0, 1.0), longest=0.05)
    assert "closes on itself" in str(branch.ends[1])
    np.testing.assert_allclose(sorted(f.value for f in branch.folds()), [-0.2, 0.2], rtol=1e-8)


class TestFindCycles:
    def test_two_cycles_of_the_bogie_at_90(self, cycles_at_90):
        """PUBLISHED: the exact periodic orbits at 90 m/s; H = 15 is good to 3e-4 in amplitude, 2e-5 in frequency."""
        small, large = cycles_at_90
        for orbit, omega, a1, a3, verdict in (
            (small, 27.043851, 0.00945603, 0.00852216, "unstable"),
            (large, 27.777184, 0.01001397, 0.00939986, "stable"),
        ):
            assert orbit.omega == pytest.approx(omega, rel=2e-5)
            assert orbit.amplitude("q1") == pytest.approx(a1, rel=3e-4)
            assert orbit.amplitude("q3") == pytest.approx(a3, rel=3e-4)
            assert orbit.stability.verdict == verdict
        assert small.stability.unstable == 1

    def test_none_below_the_fold(self, bogie):
        assert hb.find_cycles(bogie, V=85.0) == []

    def test_one_cycle_beyond_the_hopf_point(self, bogie):
        (cycle,) = hb.find_cycles(bogie, V=100.86)
        assert cycle.amplitude("q1") == pytest.approx(0.01116129, rel=3e-4)
        assert cycle.stability.verdict == "stable"

    @pytest.mark.parametrize(("mu", "H", "period"), [(1.0, 31, 6.66328685932313019), (5.0, 121, 11.61223066771957)])
    def test_van_der_pol(self, mu, H, period):
        """PUBLISHED periods; the branch begins on a vertical line, so a simulation leads there."""
        (cycle,) = hb.find_cycles(hb.load_problem("van_der_pol").van_der_pol(mu=mu), harmonics=H)
        assert cycle.period == pytest.approx(period, rel=1e-10)
        assert cycle.stability.verdict == "stable"

    def test_van_der_pol_backwards_in_time(self):
        """Where mu < 0 the same cycle repels; its multiplier is the inverse of the PUBLISHED one."""
        (cycle,) = hb.find_cycles(hb.load_problem("van_der_pol").van_der_pol(mu=-1.0))
        assert cycle.period == pytest.approx(6.66328685932313019, rel=1e-9)
        assert cycle.stability.verdict == "unstable"
        assert cycle.stability.critical.real == pytest.approx(1 / 8.596950636e-4, rel=1e-8)

    def test_backwards_motions_of_a_velocity_dependent_contact(self):
        """Backwards in time x' has the other sign, in the equation and in the argument of the contact."""
        x, d = hb.Coordinate("x", "m"), hb.Parameter("d", 0.1, "1/s")
        stop = hb.Element("stop", hb.model.DeadBand(0.3, 1.0), x.dot)
        system = hb.System("stop", [x], [d], [x.ddot + d * x.dot + stop + x], [stop])
        there = hb.simulate(system, {"x": 1.0}, 5.0)
        end = {"x": float(there.q[-1, 0]), "x'": -float(there.v[-1, 0])}
        back = hb.simulate(system.backwards(), end, 5.0)
        assert there.q[-1, 0] != pytest.approx(1.0, rel=0.1)
        assert back.q[-1, 0] == pytest.approx(1.0, rel=1e-6) and back.v[-1, 0] == pytest.approx(0.0, abs=1e-6)

    def test_both_bautin_cycles(self):
        problem = hb.load_problem("bautin")
        system = problem.bautin(mu=-0.1)
        cycles = hb.find_cycles(system, mu=-0.1)
        np.testing.assert_allclose([c.amplitude("x") for c in cycles], sorted(problem.radii(-0.1)), rtol=1e-9)
        assert [c.stability.verdict for c in cycles] == ["unstable", "stable"]

    @pytest.mark.parametrize("mu", [-1e-4, -3e-5, -1e-6])
    def test_small_cycles_next_to_the_hopf_point(self, mu):
        """A cycle of amplitude a answers to a residual with its 1 / (2 a^2): 1e-6 at mu = -1e-6."""
        problem = hb.load_problem("bautin")
        cycles = hb.find_cycles(problem.bautin(mu=mu), mu=mu)
        np.testing.assert_allclose([c.amplitude("x") for c in cycles], sorted(problem.radii(mu)), rtol=1e-5)

    @pytest.mark.parametrize("name", ["duffing", "gap_oscillator"])
    def test_a_family_is_not_a_list(self, name):
        with pytest.raises(ModelError, match="continuous family"):
            hb.find_cycles(getattr(hb.load_problem(name), name)(), d=0.0)

    @pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
    def test_as_many_harmonics_as_the_tolerance_takes(self, tolerance):
        """The frequency is that of the polished cycle: its error is below the estimate, and that is small.

        Where harmonics are not enough it is by collocation, and says so.
        """
        (cycle,) = hb.find_cycles(hb.load_problem("van_der_pol").van_der_pol(mu=5.0), tolerance=tolerance)
        assert cycle.errors["waveform"] <= tolerance
        assert cycle.H > 15 and ("meets" in cycle.status or "harmonics leave an error of" in cycle.status)
        error = abs(cycle.omega - 2 * np.pi / 11.61223066771957)
        assert error <= cycle.errors["omega"] <= 1e-9

    def test_error_bars_of_both_bogie_cycles(self, cycles_at_90):
        """Against exact periodic orbits, printed to eight digits."""
        for cycle, omega, a1 in zip(cycles_at_90, (27.043851, 27.777184), (0.00945603, 0.01001397), strict=True):
            assert cycle.errors["omega"] == pytest.approx(abs(cycle.omega - omega), abs=1e-6)
            assert cycle.errors["q1"] == pytest.approx(abs(cycle.amplitude("q1") - a1), abs=1e-8)

    def test_harmonics_must_be_a_number_or_auto(self, bogie):
        with pytest.raises(ModelError, match="'auto'"):
            hb.find_cycles(bogie, harmonics="many", V=90.0)

    def test_too_few_harmonics_are_reported(self):
        """At mu = 20 five harmonics are a caricature with another period; the trivial multiplier tells, too."""
        system = hb.load_problem("van_der_pol").van_der_pol(mu=20.0)
        with pytest.raises(hb.ConvergenceError, match="do not resolve"):
            hb.find_cycles(system, harmonics=5)
        guess = hb.motion.last_orbit(system, hb.motion.settle(system, {"x": 1.0}, longest=1e3).trajectory, 5)
        found = hb.floquet(system, hb.solve(hb.HarmonicBalance(5).equations(system), guess))
        assert found.verdict == "unknown" and found.trivial_error > 0.01

    @pytest.mark.slow
    def test_strong_relaxation_oscillation(self):
        """127 harmonics do not resolve it. The asymptotic period of J. Grasman (1987) is good to O(ln mu / mu)."""
        (cycle,) = hb.find_cycles(hb.load_problem("van_der_pol").van_der_pol(mu=30.0))
        assert cycle.period == pytest.approx((3 - 2 * np.log(2)) * 30 + 7.014 * 30 ** (-1 / 3), rel=0.01)
        assert cycle.errors["omega"] < 1e-9 and "collocation" in cycle.status

    @pytest.mark.parametrize("size", [1e-6, 1e6])
    def test_another_unit_of_length(self, size):
        """x / size instead of x in van der Pol's equation: the same cycle, backwards in time as well."""
        x, mu = hb.Coordinate("x"), hb.Parameter("mu", 1.0)
        system = hb.System("scaled", [x], [mu], [x.ddot - mu * (1 - (x / size) ** 2) * x.dot + x])
        for value in (1.0, -1.0):
            (cycle,) = hb.find_cycles(system, mu=value)
            assert cycle.period == pytest.approx(6.66328685932313019, rel=1e-9)
            assert cycle.amplitude("x") == pytest.approx(2.00861986087484314 * size, rel=1e-5)

    @pytest.mark.parametrize("rate", [1e-3, 1e3])
    def test_another_unit_of_time(self, rate):
        x, mu = hb.Coordinate("x"), hb.Parameter("mu", 1.0)
        equation = x.ddot - mu * rate * (1 - x**2) * x.dot + rate**2 * x
        (cycle,) = hb.find_cycles(hb.System("fast", [x], [mu], [equation]))
        assert cycle.period * rate == pytest.approx(6.66328685932313019, rel=1e-9)

    @pytest.mark.parametrize("order", ["xyz", "zxy"])
    def test_the_order_of_the_equations_does_not_matter(self, order):
        """In closed form: rest of z, the first of the coordinates, moves at second order only."""
        x, y, z = (hb.Coordinate(n) for n in "xyz")
        mu = hb.Parameter("mu", -0.1)
        g = mu + (x**2 + y**2) - (x**2 + y**2) ** 2
        equations = {"x": x.dot - g * x + y, "y": y.dot - g * y - x, "z": z.dot + z + z**3 - x**2}
        coordinates = {"x": x, "y": y, "z": z}
        system = hb.System("order", [coordinates[n] for n in order], [mu], [equations[n] for n in order])
        radii = [((1 - 0.6**0.5) / 2) ** 0.5, ((1 + 0.6**0.5) / 2) ** 0.5]
        found = hb.find_cycles(system)
        assert [c.first_harmonic("x") for c in found] == pytest.approx(radii, rel=1e-9)
        critical = hb.critical_speeds(system, "mu", (-1.0, 1.0))
        assert [(c.kind, c.value) for c in critical] == [("fold", pytest.approx(-0.25, abs=1e-9)), ("hopf", 0.0)]


def test_unfinished_names_the_end_that_was_not_reached():
    """Of a branch that reaches the end of the interval one way, and runs out of points the other way."""
    system = hb.load_problem("bautin").bautin()
    balance = hb.HarmonicBalance(3).equations(system)
    cycle = max(hb.find_cycles(system, mu=0.45), key=lambda o: o.amplitude("x"))
    branch = hb.trace(balance, cycle, "mu", (-0.5, 0.5), max_points=8)
    assert [end.kind for end in branch.ends] == ["points", "interval"]
    assert branch.unfinished == str(branch.ends[0])
    assert hb.trace(balance, cycle, "mu", (0.44, 0.46)).unfinished == ""
