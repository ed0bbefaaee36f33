"""Branches that a census follows: around folds that only motions lead to, off vertical families, up to homoclinics."""

import numpy as np
import pytest
from scipy.integrate import quad

import hbbogie as hb
from hbbogie.model import DeadBand

C, P = hb.Coordinate, hb.Parameter


def pair(mu: float) -> hb.System:
    """r' = r (mu - (r^2 - 1)^2), one turn in 2 pi, and z' = -z: circles r^2 = 1 +- sqrt(mu), a Hopf point at mu = 1."""
    x, y, z, m = C("x"), C("y"), C("z"), P("mu", mu)
    g = m - (x**2 + y**2 - 1) ** 2
    return hb.System("pair", [x, y, z], [m], [x.dot - x * g + y, y.dot - y * g - x, z.dot + z])


def energy(h: float) -> hb.System:
    """x'' = x - x^3 - (E - h) x': cycles are curves of energy E = h, from -1/4 at rest; homoclinic at 0."""
    x, level = C("x"), P("h", h)
    E = x.dot**2 / 2 - x**2 / 2 + x**4 / 4
    return hb.System("energy", [x], [level], [x.ddot - x + x**3 + (E - level) * x.dot])


def period(h: float) -> float:
    """Period of the motion of energy h: v^2 = (s - low) (high - s) / 2 with s = x^2."""
    low, high = 1 - np.sqrt(1 + 4 * h), 1 + np.sqrt(1 + 4 * h)
    if h < 0:
        middle, half = (low + high) / 2, (high - low) / 2
        return np.sqrt(2) * quad(lambda u: 1 / np.sqrt(middle + half * np.sin(u)), -np.pi / 2, np.pi / 2)[0]
    return 4 * quad(lambda u: 1 / np.sqrt((high * np.sin(u) ** 2 - low) / 2), 0, np.pi / 2)[0]


def listed(cycles) -> list[tuple[float, str]]:
    return [(o.period, o.stability.verdict) for o in cycles]


class TestAroundFolds:
    def test_the_partner_of_a_cycle_that_only_a_motion_finds(self):
        """No Hopf point in reach, and an unstable cycle in three dimensions: no motion leads to it."""
        found = hb.find_cycles(pair(0.04), mu=0.04, interval=(-0.1, 0.1))
        assert [o.amplitude("x") for o in found] == pytest.approx([0.8**0.5, 1.2**0.5], rel=1e-8)
        assert [o.stability.verdict for o in found] == ["unstable", "stable"] and found.complete
        (said,) = (s for s in found.evidence if s.startswith("the branch through the cycle of period 6.28318531 s"))
        low = float(said.partition("from ")[2].split(" ")[0])
        assert low == pytest.approx(0.0, abs=1e-4) and said.count("the end of the interval") == 2

    def test_in_closed_form(self):
        """An airfoil with freeplay in pitch, lift at mid-chord: any angle inside the gap is one of rest."""
        h, a, U = C("h"), C("a"), P("U", 0.45, "1", "", (0.05, 4.0))
        gap = hb.Element("gap", DeadBand(0.25, 0.5), a)
        lift = 0.04 * np.pi * U**2 * (a + (h.dot + a.dot) / U)
        plunge = h.ddot + 0.2 * a.ddot + 0.01 * h.dot + 0.5 * h + lift
        airfoil = hb.System(
            "airfoil", [h, a], [U], [plunge, 0.2 * h.ddot + 0.25 * a.ddot + 0.0125 * a.dot + gap], [gap]
        )
        found = hb.find_cycles(airfoil, U=0.45, interval=(0.15, 0.55))
        assert [o.stability.verdict for o in found] == ["unstable", "stable"]
        for cycle in found:  # two methods agree
            assert hb.verify(airfoil, cycle).orbit.omega == pytest.approx(cycle.omega, rel=1e-9)
        assert any("through the cycle" in s and "in closed form" in s for s in found.evidence)

    def test_a_branch_that_cannot_be_followed_is_said(self, monkeypatch):
        def refuse(*_, **__):
            raise hb.ConvergenceError("no way on")

        for name in ("balanced_trace", "followed_from"):
            monkeypatch.setattr(f"hbbogie.branches.walks.{name}", refuse)
        found = hb.find_cycles(pair(0.04), mu=0.04, interval=(-0.1, 0.1))
        assert len(found) == 1 and not found.complete
        assert found.undecided == ("the branch through the cycle of period 6.28318531 s was not followed: no way on",)


class TestHomoclinic:
    def test_a_branch_ends_there_and_says_so(self):
        (hopf, _) = hb.hopf_points(energy(-0.1), "h", (-0.5, 0.5))
        assert hopf.value == pytest.approx(-0.25, abs=1e-11)
        branch = hb.trace(hb.HarmonicBalance(15).equations(energy(-0.1)), hopf, "h", (-0.5, 0.5))
        end = branch.ends[1]
        assert end.kind == "homoclinic" and end.complete and abs(branch.values[-1]) < 1e-3
        assert "at the equilibrium x = 0; the period" in str(end) and "collocation" in end.advice
        judged = [o.stability.verdict for o in branch.orbits if o.period < 9]
        assert set(judged) <= {"stable", "unknown"} and judged.count("stable") > len(judged) / 2

    @pytest.mark.parametrize(("h", "count"), [(-0.1, 2), pytest.param(-1e-3, 2, marks=pytest.mark.slow), (0.1, 1)])
    def test_cycles_on_both_sides_of_it(self, h, count):
        found = hb.find_cycles(energy(h), h=h, interval=(-0.5, 0.5))
        assert listed(found) == [(pytest.approx(period(h), rel=1e-6), "stable")] * count and found.complete

    def test_no_cycle_is_an_answer_where_motions_backwards_leave_every_bound(self):
        """The energy falls along every motion, h being below its least value -1/4."""
        none = hb.find_cycles(energy(-0.5), h=-0.5, interval=(-0.8, -0.3))
        assert none == [] and none.complete and "left every bound" in " ".join(none.evidence)


class TestVerticalFamilies:
    @pytest.mark.parametrize("cubic", [0.0, 1.0])
    def test_they_are_left_where_another_branch_crosses(self, cubic):
        """x'' + x + c x^3 = mu (1 - x^2) x' backwards in time is itself at -mu; motions go forwards only."""
        x, z, mu = C("x"), C("z"), P("mu", 0.5, "1", "", (-1.0, 1.0))
        equation = x.ddot + x + cubic * x**3 - mu * (1 - x**2) * x.dot
        system = hb.System("both", [x, z], [mu], [equation, z.dot + z])
        (stable,), (unstable,) = (hb.find_cycles(system, mu=m) for m in (1.0, -1.0))
        assert [o.stability.verdict for o in (stable, unstable)] == ["stable", "unstable"]
        assert stable.period == pytest.approx(unstable.period, rel=1e-9)
        if not cubic:
            assert stable.period == pytest.approx(6.66328685932313, rel=1e-9)

    def test_each_branch_that_crosses_is_found(self):
        """x'' + x = mu (1 - x^2 + x^4 / 10) x': 1 - A^2 / 4 + A^4 / 80 = 0 as mu goes to 0."""
        x, mu = C("x"), P("mu", 0.01)
        system = hb.System("two", [x], [mu], [x.ddot + x - mu * (1 - x**2 + x**4 / 10) * x.dot])
        found = hb.find_cycles(system, mu=0.01, interval=(-0.5, 0.5))
        sizes = np.sqrt(np.roots([1 / 80, -1 / 4, 1])[::-1])
        assert [o.amplitude("x") for o in found] == pytest.approx(sizes, rel=1e-3)
        assert [o.stability.verdict for o in found] == ["stable", "unstable"]

    def test_critical_values_follow_the_branches_that_leave(self):
        x, mu = C("x"), P("mu", 0.5, "1", "", (-1.0, 1.0))
        found = hb.critical_speeds(hb.System("both", [x], [mu], [x.ddot + x - mu * (1 - x**2) * x.dot]), "mu", (-1, 1))
        assert any("from -1 to 1" in sentence for sentence in found.evidence)


def test_a_limit_says_what_was_not_looked_at():
    found = hb.find_cycles(pair(0.04), mu=0.04, interval=(-0.1, 0.1), limit=1e-9)
    said = " ".join(found.evidence)
    assert not found.complete and "singular" not in said and "no equilibrium was found" not in said
    assert "not all equilibria found were followed" in said


def test_the_default_interval_stays_on_its_side_of_a_pole():
    """van der Pol's oscillator with mu = 1 / L^2."""
    x, L = C("x"), P("L", 1.0)
    found = hb.find_cycles(hb.System("pole", [x], [L], [x.ddot + x - (1 - x**2) * x.dot / L**2]), L=1.0)
    assert listed(found) == [(pytest.approx(6.66328685932313, rel=1e-9), "stable")]
    assert not any("L = -" in sentence or "from -" in sentence for sentence in found.evidence)


def test_conserved_quantities_keep_their_level():
    """An epidemic, k I^2 S, with S + I + R = 1: the same cycle as with S left out, and no mirror image."""
    S, I, R, k = C("S"), C("I"), C("R"), P("k", 23.5, "1", "", (1.0, 100.0))
    whole = hb.System(
        "whole", [S, I, R], [k], [S.dot - 0.3 * R + k * I**2 * S, I.dot - k * I**2 * S + I, R.dot - I + 0.3 * R]
    )
    small = hb.System("small", [I, R], [k], [I.dot - k * I**2 * (1 - I - R) + I, R.dot - I + 0.3 * R])
    c = 1 + 1 / 0.3  # rest at I: k I (1 - c I) = 1; the trace 0.7 - k I^2 vanishes at k = (1 + 0.7 c)^2 / 0.7
    (hopf,) = hb.hopf_points(small, "k", (20.0, 30.0))
    assert hopf.value == pytest.approx((1 + 0.7 * c) ** 2 / 0.7, rel=1e-11)
    (one,) = hb.find_cycles(whole, k=23.5, interval=(20.0, 30.0), start={"S": 0.25, "I": 0.17, "R": 0.58})
    (other,) = hb.find_cycles(small, k=23.5, interval=(20.0, 30.0))
    assert one.period == pytest.approx(other.period, rel=1e-9)
    assert one.coefficients[0].sum() == pytest.approx(1.0, abs=1e-12)


def test_equilibria_within_wide_bounds():
    """Predators and prey that need company: n = 0, 0.2 and 1 without predators, whatever the bounds."""
    n, q, m = C("n", bounds=(0, 100)), C("q", bounds=(0, 100)), P("m", 0.5, "1", "", (0.01, 2))
    system = hb.System("allee", [n, q], [m], [n.dot - n * (1 - n) * (n - 0.2) + n * q, q.dot - q * (n - m)])
    found = hb.find_equilibria(system, "m", (0.01, 1.6))
    assert sorted({round(float(b.orbits[0].coefficients[0, 0]), 6) for b in found}) == [0.0, 0.2, 1.0]
    (hopf,) = (s for b in found for s in b.special if s.kind == "hopf")
    assert hopf.value == pytest.approx(0.6, rel=1e-11)


class TestWhereHarmonicsEnd:
    def test_collocation_goes_on_and_a_branch_between_two_hopf_points_is_followed_once(self):
        """FitzHugh-Nagumo: canards between Hopf points 0.331281 and 1.418719, each with a fold of cycles near by.

        The fold at I = 0.3241785225 and the period at 0.5 are those of collocation with 400 intervals; the cubic is
        odd about I = 0.875.
        """
        v, w, current = C("v"), C("w"), P("I", 0.5)
        system = hb.System(
            "FitzHugh-Nagumo",
            [v, w],
            [current],
            [v.dot - (v - v**3 / 3 - w + current), w.dot - 0.08 * (v + 0.7 - 0.8 * w)],
        )
        found = hb.find_cycles(system, I=0.5)
        assert listed(found) == [(pytest.approx(39.474415, abs=5e-7), "stable")]
        said = "\n".join(found.evidence)
        assert (
            "no longer resolve the cycles" in said and "by collocation, was followed from 0.324179 to 1.42582" in said
        )
        assert "I = 1.41871866 is one that was followed and ends there" in said

    @pytest.mark.parametrize(
        ("rate", "start", "end"),
        [
            (lambda x: x**2, 1.0, "left every bound"),
            (lambda x: -1 / (1 + x), 0.0, "ended where the equations are singular"),
        ],
    )
    def test_motions_that_end_in_finite_time(self, rate, start, end):
        """x' = x^2 from 1 is 1 / (1 - t); x' = -1 / (1 + x) from 0 is the root of 1 - 2 t, less 1."""
        x, y, p = C("x"), C("y"), P("p", 0.0)
        system = hb.System("finite", [x, y], [p], [x.dot - rate(x) - p, y.dot + y])
        none = hb.find_cycles(system, p=0.0, start=[start, 0.1], backwards=False)
        assert none == [] and none.evidence[-1] == f"1 motions: 1 {end}"
