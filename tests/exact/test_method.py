"""Cycles in closed form through `solve` and `trace`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import fourier
from hbbogie.exact import Exact
from hbbogie.model import DeadBand, Saturation

C, P = hb.Coordinate, hb.Parameter


def chua() -> hb.System:
    """Chua's circuit: T. Matsumoto, IEEE Trans. Circuits Syst. 31 (1984) 1055, slopes -8/7 and -5/7, beta 100/7."""
    x, y, z, alpha = C("x"), C("y"), C("z"), P("alpha", 8.0)
    diode = hb.Element("diode", Saturation(1.0, 1.0), x)
    current = -5 / 7 * x - 3 / 7 * diode
    equations = [x.dot - alpha * (y - x - current), y.dot - (x - y + z), z.dot + 100 / 7 * y]
    return hb.System("chua", [x, y, z], [alpha], equations, [diode])


@pytest.fixture(scope="module")
def chua_branches():
    system = chua()
    equations = Exact().equations(system)
    points = hb.hopf_points(system, "alpha", (6.0, 8.5))
    return system, [hb.trace(equations, hopf, "alpha", (6.0, 8.5)) for hopf in points]


class TestBogie:
    def test_branch_from_its_hopf_point(self, bogie):
        (hopf,) = hb.hopf_points(bogie, "V", (60.0, 190.0))
        branch = hb.trace(Exact().equations(bogie), hopf, "V", (60.0, 190.0))
        assert [s.kind for s in branch.special] == ["hopf", "grazing", "grazing", "fold"]
        (fold,) = branch.folds()
        assert fold.value == pytest.approx(88.7641131943, abs=5e-11) and fold.extremum == "minimum"
        assert branch.values[-1] == pytest.approx(190.0, rel=1e-14) and branch.verdicts[-1] == "stable"

    def test_branch_from_a_cycle_goes_both_ways(self, bogie):
        cycle = hb.find_cycles(bogie, V=90.0)[0]
        branch = hb.trace(Exact().equations(bogie), cycle, "V", (60.0, 190.0))
        assert {end.kind for end in branch.ends} == {"interval", "contact"}
        assert branch.folds()[0].value == pytest.approx(88.7641131943, abs=5e-11)

    @pytest.mark.parametrize("V", [100.0, 180.0])
    def test_a_cycle_at_another_speed(self, bogie, V):
        """Multiple shooting with located contacts has the same frequency and multipliers."""
        guess = hb.find_cycles(bogie, V=90.0)[-1]
        cycle = hb.solve(Exact().equations(bogie), guess, V=V)
        truth = hb.verify(bogie, cycle).orbit
        assert cycle.omega == pytest.approx(truth.omega, rel=1e-10)
        assert abs(cycle.stability.critical) == pytest.approx(abs(truth.stability.critical), rel=1e-6)

    def test_fold_and_gradient(self, bogie):
        """By V = 88.7641131943 m/s, and by harmonic balance with many harmonics for the gradient."""
        (hopf,) = hb.hopf_points(bogie, "V", (60.0, 190.0))
        exact = Exact().equations(bogie)
        (point,) = hb.trace(exact, hopf, "V", (60.0, 190.0)).folds()
        found, near = hb.fold(exact, point), hb.fold(hb.HarmonicBalance(63).equations(bogie), point)
        assert found.value == pytest.approx(88.7641131943, abs=5e-11) and found.extremum == "minimum"
        assert found.error < 1e-8
        for name, elasticity in near.elasticities.items():
            assert found.elasticities[name] == pytest.approx(elasticity, abs=5e-7)
        with pytest.raises(hb.ConvergenceError, match="do not depend on W"):
            hb.fold(exact, point, "W")  # the axle load acts through the gravity stiffness only
        far = hb.find_cycles(bogie, V=150.0)[-1]
        with pytest.raises(hb.ConvergenceError, match=r"branch\.folds"):
            hb.fold(exact, far, "V")
        with pytest.raises(hb.ModelError, match="give its name"):
            hb.fold(exact, far)


class TestChua:
    def test_period_doubling(self, chua_branches):
        """By an independent method: a multiplier of shooting is -1 there."""
        system, (one, other) = chua_branches
        (doubling,) = (s for s in one.special if s.kind == "period doubling")
        (mirrored,) = (s for s in other.special if s.kind == "period doubling")
        assert mirrored.value == pytest.approx(doubling.value, rel=1e-11)
        multipliers = hb.verify(system, doubling.orbit).orbit.stability.multipliers
        assert np.abs(multipliers + 1).min() < 1e-6
        for value, verdict in list(zip(one.values, one.verdicts, strict=True))[2:]:
            if abs(value - doubling.value) > 1e-6:
                assert verdict == ("stable" if value < doubling.value else "unstable")

    def test_harmonic_balance_agrees(self, chua_branches):
        system, (one, _) = chua_branches
        (hopf, _) = hb.hopf_points(system, "alpha", (6.0, 8.5))
        branch = hb.trace(hb.HarmonicBalance(31).equations(system), hopf, "alpha", (6.0, 8.5))
        near, exact = ([s.value for s in b.special if s.kind == "period doubling"] for b in (branch, one))
        assert near == pytest.approx(exact, rel=1e-6)
        for b in (branch, one):  # alpha rises along the branch, where the equilibrium has lost its stability
            assert next(s for s in b.special if s.kind == "hopf").criticality == "supercritical"

    def test_branch_of_the_doubled_cycles(self, chua_branches):
        """They begin with twice the period, go apart as the root of the distance, and are closed by shooting."""
        system, (one, _) = chua_branches
        (doubling,) = (s for s in one.special if s.kind == "period doubling")
        branch = hb.trace(Exact().equations(system), doubling, "alpha", (6.0, 8.5))
        assert branch.ends[0].kind == "began" and "period doubling" in str(branch.ends[0])
        assert branch.orbits[0].period == pytest.approx(2 * doubling.orbit.period, rel=1e-4)
        apart, away = [], branch.values - doubling.value
        for orbit in branch:
            first, second = np.split(orbit.at(fourier.phases(256)), 2)
            apart.append(np.abs(first - second).max())
        near = (away > 0) & (away < 0.02)
        slope = np.polyfit(np.log(away[near]), np.log(np.array(apart)[near]), 1)[0]
        assert slope == pytest.approx(0.5, abs=0.05)
        truth = hb.verify(system, branch.orbits[2])
        assert truth.orbit.omega == pytest.approx(branch.orbits[2].omega, rel=1e-10)
        assert truth.orbit.stability.verdict == branch.orbits[2].stability.verdict == "stable"
        assert [s.kind for s in branch.special] == ["period doubling"]  # the next one of the cascade

    def test_a_guess_that_leads_back_is_refused(self, chua_branches):
        system, (one, _) = chua_branches
        (doubling,) = (s for s in one.special if s.kind == "period doubling")
        beside = hb.solve(Exact().equations(system), doubling.orbit, alpha=8.1)
        again = beside.replace(coefficients=_passed_twice(beside), omega=beside.omega / 2)
        with pytest.raises(hb.ConvergenceError, match="comes back to the branch"):
            hb.trace(Exact().equations(system), replace(doubling, onward=again), "alpha", (6.0, 8.5))


def _passed_twice(orbit: hb.Orbit) -> np.ndarray:
    c = np.zeros((4 * orbit.H + 1, len(orbit.coordinates)))
    c[0] = orbit.coefficients[0]
    c[3::4], c[4::4] = orbit.coefficients[1::2], orbit.coefficients[2::2]
    return c


def test_pitchfork_of_an_odd_system():
    """The circuit of Freire et al. with dead bands for its cubics: mean values grow from zero as the root."""
    x, y, z, v = C("x"), C("y"), C("z"), P("v", -0.59)
    first, second = hb.Element("first", DeadBand(0.6, 0.3), x), hb.Element("second", DeadBand(1.5, 0.3), y - x)
    equations = [0.6 * x.dot + (0.5 + v) * x - 0.5 * y + first - second, y.dot - 0.5 * x - 0.1 * y + z + second]
    system = hb.System("corners", [x, y, z], [v], [*equations, z.dot - y], [first, second])
    exact = Exact().equations(system)
    (hopf,) = hb.hopf_points(system, "v", (-0.65, -0.5))
    (fork,) = (s for s in hb.trace(exact, hopf, "v", (-0.65, -0.5)).special if s.kind == "pitchfork")
    branch = hb.trace(exact, fork, "v", (-0.65, -0.5))
    assert "mirror image" in str(branch.ends[0])
    means, away = np.array([abs(o.mean("x")) for o in branch]), np.abs(branch.values - fork.value)
    assert np.log(means[2] / means[0]) / np.log(away[2] / away[0]) == pytest.approx(0.5, abs=0.05)
    truth = hb.verify(system, branch.orbits[4])
    assert truth.orbit.omega == pytest.approx(branch.orbits[4].omega, rel=1e-10)
    assert truth.orbit.stability.verdict == branch.orbits[4].stability.verdict


class TestTwoContacts:
    """Friction that saturates, and a stop on one side: the stop is lost on the way to the end of the interval."""

    @pytest.fixture
    def stopped(self):
        x, L = C("x"), P("L", 0.05)
        stop = hb.Element("stop", DeadBand(20.0, 0.1), x - 0.03)
        friction = hb.Element("friction", Saturation(0.6, L), x.dot)
        equations = [x.ddot + 0.25 * x.dot - friction + x + stop]
        return hb.System("stopped", [x], [L], equations, [stop, friction])

    def test_the_branch_goes_on_without_the_stop(self, stopped):
        exact = Exact().equations(stopped)
        cycle = hb.find_cycles(stopped, L=0.05, interval=(0.005, 0.4))[0]
        branch = hb.trace(exact, cycle, "L", (0.005, 0.4))
        assert [end.kind for end in branch.ends] == ["interval", "interval"]
        assert branch.values[[0, -1]] == pytest.approx([0.005, 0.4], rel=1e-12)
        balanced = hb.solve(hb.HarmonicBalance(41).equations(stopped), branch.orbits[0], L=0.008)
        assert hb.solve(exact, cycle, L=0.008).amplitude("x") == pytest.approx(balanced.amplitude("x"), rel=1e-4)

    def test_the_motion_shrinks_with_the_friction(self, stopped):
        """Away from the stop the motion and the limit of the friction have the same scale, and vanish together."""
        cycle = hb.find_cycles(stopped, L=0.05, interval=(0.005, 0.4))[0]
        branch = hb.trace(Exact().equations(stopped), cycle, "L", (-0.1, 0.4))
        assert [end.kind for end in branch.ends] == ["vanishes", "interval"]
        assert 0 < branch.values[0] < 1e-5
        share = branch.amplitude("x")[:4] / branch.values[:4]
        assert share[:3] == pytest.approx(share[3], rel=1e-9)

    def test_a_limit_of_time(self, stopped):
        cycle = hb.find_cycles(stopped, L=0.05, interval=(0.005, 0.4))[0]
        branch = hb.trace(Exact().equations(stopped), cycle, "L", (0.005, 0.4), limit=1e-9)
        assert {end.kind for end in branch.ends} == {"limit"}


class TestErrors:
    def test_what_is_not_linear_between_switchings(self):
        with pytest.raises(hb.ModelError, match="HarmonicBalance"):
            Exact().equations(hb.load_problem("van_der_pol").van_der_pol())

    def test_only_at_given_values(self, bogie):
        exact, cycle = Exact().equations(bogie), hb.find_cycles(bogie, V=90.0)[-1]
        with pytest.raises(hb.ModelError, match="at given parameter values"):
            hb.solve(exact, cycle, free="V", amplitude={"q1": 0.01})
        with pytest.raises(hb.ModelError, match="outside the interval"):
            hb.trace(exact, cycle, "V", (100.0, 190.0))
        (hopf,) = hb.hopf_points(bogie, "V", (60.0, 190.0))
        with pytest.raises(hb.ModelError, match="outside the interval"):
            hb.trace(exact, hopf, "V", (100.0, 190.0))
        with pytest.raises(hb.ConvergenceError, match="turns back or ends"):
            hb.solve(exact, cycle, V=88.0)
