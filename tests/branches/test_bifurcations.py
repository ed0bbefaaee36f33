"""Special points along branches: published numbers, closed forms, what begins at each of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from known_cycles import lure

import hbbogie as hb
from hbbogie import Coordinate, Element, HarmonicBalance, ModelError, Parameter, System, fourier
from hbbogie.branches import crossings, onset
from hbbogie.model import DeadBand

circuit = hb.load_problem("circuit")


def only(branch: hb.Branch, kind: str) -> hb.results.SpecialPoint:
    (point,) = (s for s in branch.special if s.kind == kind)
    return point


def traced(system: System, parameter: str, interval: tuple[float, float], H: int = 15, **options) -> hb.Branch:
    (hopf,) = hb.hopf_points(system, parameter, interval)
    return hb.trace(HarmonicBalance(H).equations(system), hopf, parameter, interval, **options)


@pytest.fixture(scope="module")
def biased() -> hb.Branch:
    return traced(circuit.circuit(**circuit.BIASED), "v", (-0.65, -0.5), 25)


@pytest.fixture(scope="module")
def symmetric() -> hb.Branch:
    return traced(circuit.circuit(**circuit.SYMMETRIC), "v", (-0.7, -0.5))


@pytest.fixture(scope="module")
def broken(symmetric: hb.Branch) -> hb.Branch:
    equations = HarmonicBalance(15, odd=False).equations(circuit.circuit(**circuit.SYMMETRIC))
    return hb.trace(equations, only(symmetric, "pitchfork"), "v", (-0.65, -0.5))


LAST_DIGIT = "the last printed digit is one off: shooting has the same {} to nine digits"


class TestPublished:
    @pytest.mark.parametrize(
        ("kind", "quantity"),
        [
            ("fold", "v"),
            pytest.param("fold", "T", marks=pytest.mark.xfail(strict=True, reason=LAST_DIGIT.format("T"))),
            pytest.param("Neimark-Sacker", "v", marks=pytest.mark.xfail(strict=True, reason=LAST_DIGIT.format("v"))),
            ("Neimark-Sacker", "T"),
            ("period doubling", "v"),
            ("period doubling", "T"),
        ],
    )
    def test_biased_circuit(self, biased, kind, quantity):
        (printed,) = (p for p in circuit.BIASED_POINTS if p.kind == kind)
        point = only(biased, kind)
        if quantity == "v":
            assert abs(point.value - printed.v) <= 5e-7
        else:
            assert abs(point.orbit.period - printed.T) <= 5e-6

    @pytest.mark.parametrize("printed", circuit.BIASED_POINTS, ids=lambda p: p.kind)
    def test_digits_by_shooting(self, biased, printed):
        """Where the harmonics locate a point, the multipliers of the cycle polished by shooting say the same."""
        point = only(biased, printed.kind)
        checked = hb.verify(circuit.circuit(**circuit.BIASED), point.orbit)
        m = checked.multipliers
        assert checked.orbit.period == pytest.approx(point.orbit.period, rel=1e-9)
        if printed.kind == "Neimark-Sacker":  # the modulus changes by 19.6 per unit of v: v is within 5e-9
            assert np.sort(np.abs(np.abs(m) - 1))[2] < 1e-7
        elif printed.kind == "period doubling":
            assert np.abs(m + 1).min() < 1e-7
        else:  # two multipliers meet at 1: they carry the root of the error
            assert np.sort(np.abs(m - 1))[1] < 1e-3

    @pytest.mark.parametrize("printed", circuit.SYMMETRIC_POINTS, ids=lambda p: p.kind)
    def test_symmetric_circuit(self, symmetric, printed):
        """Nine digits of the Hopf point and of the pitchfork, six of the fold."""
        point, half_unit = only(symmetric, printed.kind), 5e-7 if printed.kind == "fold" else 5e-10
        assert abs(point.value - printed.v) <= half_unit
        if printed.T is not None:
            assert abs(point.orbit.period - printed.T) <= 10 * half_unit

    @pytest.mark.parametrize("tolerance", [1e-7, 1e-9, 1e-12])
    @pytest.mark.parametrize(("step", "longest"), [(0.02, 0.3), (0.005, 0.05), (0.1, 1.0)])
    def test_pitchfork_survives_all_tolerances(self, tolerance, step, longest):
        """Wherever the steps lie and however loosely they are solved it is found, within the error that it reports."""
        system = circuit.circuit(**circuit.SYMMETRIC)
        branch = traced(system, "v", (-0.6, -0.57), tolerance=tolerance, step=step, longest=longest)
        point = only(branch, "pitchfork")
        low, high = point.interval
        assert low - 5e-10 <= -0.587028974 <= high + 5e-10
        assert high - low < max(1e-7, 0.1 * tolerance**0.5)

    def test_lure(self):
        """Period doubling at alpha = 0.63030200616, T = 6.3640713394."""
        system, orbit = lure()
        start = orbit.replace(parameters={"alpha": 0.7})
        branch = hb.trace(HarmonicBalance(25).equations(system), start, "alpha", (0.6, 0.9))
        point = only(branch, "period doubling")
        assert point.interval[0] <= 0.63030200616 <= point.interval[1]
        assert point.value == pytest.approx(0.63030200616, rel=1e-9)
        assert point.orbit.period == pytest.approx(6.3640713394, abs=5e-9)


class TestConsistency:
    @pytest.mark.parametrize("name", ["biased", "symmetric", "broken", "branch"])
    def test_verdicts_change_at_special_points_only(self, request, name):
        """Between neighbours without a special point among them the number of unstable directions is one."""
        branch = request.getfixturevalue(name)
        places = {id(s.orbit) for s in branch.special}
        known = [o for o in branch.orbits if o.stability.verdict != "unknown" or id(o) in places]
        changes = [(a, b) for a, b in pairwise(known) if not {id(a), id(b)} & places]
        assert all(a.stability.unstable == b.stability.unstable for a, b in changes)

    def test_all_special_points_are_points_of_the_branch(self, biased):
        ids = {id(o) for o in biased.orbits}
        assert all(id(s.orbit) in ids for s in biased.special if s.kind != "hopf")

    def test_without_stability_folds_alone(self, biased):
        system = circuit.circuit(**circuit.BIASED)
        plain = traced(system, "v", (-0.65, -0.5), 25, stability=False)
        assert [s.kind for s in plain.special] == ["fold"]
        assert plain.folds()[0].value == pytest.approx(only(biased, "fold").value, rel=1e-12)
        assert plain.verdicts == ("unknown",) * len(plain)

    def test_saved_and_loaded(self, symmetric, tmp_path):
        symmetric.save(tmp_path / "branch.nc")
        again = hb.Branch.load(tmp_path / "branch.nc")
        for a, b in zip(symmetric.special, again.special, strict=True):
            assert (a.kind, a.value, a.status, a.criticality) == (b.kind, b.value, b.status, b.criticality)
            assert (a.onward is None) == (b.onward is None)
            if a.onward is not None and b.onward is not None:
                np.testing.assert_array_equal(a.onward.coefficients, b.onward.coefficients)


class TestSwitching:
    def test_pitchfork_leads_to_both_asymmetric_branches(self, symmetric, broken):
        """Mirror images: q(t + T/2) of one is -q(t) of the other; the mean grows from zero with opposite signs."""
        point = only(symmetric, "pitchfork")
        assert np.ptp([s.value for s in broken.special if s.kind == "period doubling"]) < 1e-9
        start = int(np.argmin(np.abs(broken.values - point.value)))
        means = np.array([o.coefficients[0, 0] for o in broken.orbits])
        assert abs(means[start]) < 1e-9 and (means[:start] * means[-1] < 0).all() and (means[start + 1 :] != 0).all()
        equations = HarmonicBalance(15, odd=False).equations(circuit.circuit(**circuit.SYMMETRIC))
        one, other = crossings(equations, broken, -0.6)
        assert one.omega == pytest.approx(other.omega, rel=1e-12)
        mirrored = -fourier.shift(one.coefficients, np.pi)
        np.testing.assert_allclose(mirrored, other.coefficients, atol=1e-9)

    def test_asymmetric_cycles_need_even_harmonics(self, symmetric):
        equations = HarmonicBalance(15, odd=True).equations(circuit.circuit(**circuit.SYMMETRIC))
        with pytest.raises(ModelError, match="odd=False"):
            hb.trace(equations, only(symmetric, "pitchfork"), "v", (-0.65, -0.5))

    def test_period_doubling_leads_to_twice_the_period(self, biased):
        """The doubled cycle begins with twice the period, unseen in the even harmonics, and is stable where the single
        one is not (supercritical): verified by shooting."""
        system = circuit.circuit(**circuit.BIASED)
        point = only(biased, "period doubling")
        doubled = hb.trace(HarmonicBalance(50).equations(system), point, "v", (-0.617, -0.5), max_points=12)
        assert "period doubling" in str(doubled.ends[0])
        first = doubled.orbits[0]
        assert first.period == pytest.approx(2 * point.orbit.period, rel=1e-3)
        odd = fourier.rows_of(range(1, first.H + 1, 2))
        sizes = [np.abs(o.coefficients[odd]).max() for o in doubled.orbits]
        away = np.abs(doubled.values - point.value)
        assert sizes[0] < 0.05 * np.abs(first.coefficients).max()
        # amplitude ~ root of the distance
        k = [i for i in range(len(away)) if 1e-6 < away[i] < 2e-4]
        slope = np.polyfit(np.log(away[k]), np.log(np.array(sizes)[k]), 1)[0]
        assert slope == pytest.approx(0.5, abs=0.05)
        checked = hb.verify(system, doubled.orbits[3])
        assert checked.orbit.period == pytest.approx(doubled.orbits[3].period, rel=1e-8)
        assert checked.orbit.stability.verdict == doubled.orbits[3].stability.verdict

    def test_two_circles_cross(self):
        """r' = r (mu - s)(s - 1 + mu), s = r^2: the circles s = mu and s = 1 - mu swap stability at mu = 1/2."""
        x, y, mu = Coordinate("x"), Coordinate("y"), Parameter("mu", 0.3)
        s = x**2 + y**2
        rate = (mu - s) * (s - 1 + mu)
        system = System("two circles", [x, y], [mu], [x.dot - x * rate + y, y.dot - y * rate - x])
        equations = HarmonicBalance(5).equations(system)
        c = np.zeros((3, 2))
        c[1, 0] = c[2, 1] = np.sqrt(0.3)
        start = hb.Orbit(system.name, ("x", "y"), ("", ""), c, 1.0, {"mu": 0.3})
        first = hb.trace(equations, start, "mu", (0.1, 0.9), longest=0.1)
        point = only(first, "branch point")
        assert point.interval[0] <= 0.5 <= point.interval[1]
        assert point.value == pytest.approx(0.5, abs=1e-6)
        np.testing.assert_allclose([o.first_harmonic("x") ** 2 for o in first.orbits], first.values, rtol=1e-6)
        other = hb.trace(equations, point, "mu", (0.1, 0.9), longest=0.1)
        np.testing.assert_allclose([o.first_harmonic("x") ** 2 for o in other.orbits], 1 - other.values, rtol=1e-6)
        assert min(other.values) == pytest.approx(0.1) and max(other.values) == pytest.approx(0.9)
        for branch in (first, other):
            lower = branch.values < 0.499
            assert {v for v, k in zip(branch.verdicts, lower, strict=True) if k} == (
                {"unstable"} if branch is first else {"stable"}
            )

    def test_trace_goes_on_from_every_kind(self, biased):
        system = circuit.circuit(**circuit.BIASED)
        equations = HarmonicBalance(25).equations(system)
        for kind in ("fold", "Neimark-Sacker"):
            point = only(biased, kind)
            again = hb.trace(equations, point, "v", (-0.6, -0.58), stability=False, max_points=30)
            assert again.folds()[0].value == pytest.approx(only(biased, "fold").value, rel=1e-9)


class TestTorus:
    def test_neutral_saddle_is_no_torus(self):
        """Radial and axial multipliers exp(-T 2 mu) and exp(T mu^2 ...) whose product passes 1 while both are real."""
        x, y, z, mu = Coordinate("x"), Coordinate("y"), Coordinate("z"), Parameter("mu", 0.5)
        rate = 1 - x**2 - y**2
        system = System(
            "saddle", [x, y, z], [mu], [x.dot - x * rate + y, y.dot - y * rate - x, z.dot - mu * z + z * rate * 0.1]
        )
        c = np.zeros((3, 3))
        c[1, 0] = c[2, 1] = 1.0
        start = hb.Orbit(system.name, ("x", "y", "z"), ("", "", ""), c, 1.0, {"mu": 1.5})
        branch = hb.trace(HarmonicBalance(3).equations(system), start, "mu", (1.0, 3.0))
        assert branch.special == ()  # multipliers exp(-4 pi) and exp(2 pi mu): product 1 at mu = 2


class TestGrazing:
    def test_bogie(self, branch):
        """The front flange at the Hopf speed, where the branch begins; the rear one just above the fold."""
        front, rear = (s for s in branch.special if s.kind == "grazing")
        assert "front flange begins to touch at" in front.status and "0.0091" in front.status
        assert front.value == pytest.approx(branch.values[0], rel=1e-12)
        assert "rear flange begins to touch" in rear.status
        assert rear.orbit.amplitude("q3") == pytest.approx(0.0091, rel=1e-10)
        assert 0 < rear.value - branch.folds()[0].value < 0.01

    def test_one_gap_in_closed_form(self):
        """A circle of radius sqrt(mu) and a gap g, whose spring drives a third coordinate only: contact at mu = g^2."""
        x, y, w = Coordinate("x"), Coordinate("y"), Coordinate("w")
        mu, g = Parameter("mu", 0.04), Parameter("g", 0.5)
        stop = Element("stop", DeadBand(stiffness=2.0, gap=g), x)
        rate = mu - x**2 - y**2
        equations = [x.dot - x * rate + y, y.dot - y * rate - x, w.dot + w + stop]
        system = System("touch", [x, y, w], [mu, g], equations, [stop])
        c = np.zeros((3, 3))
        c[1, 0] = c[2, 1] = 0.2
        start = hb.Orbit(system.name, ("x", "y", "w"), ("",) * 3, c, 1.0, {"mu": 0.04, "g": 0.5})
        branch = hb.trace(HarmonicBalance(9).equations(system), start, "mu", (0.01, 0.5), longest=0.1)
        point = only(branch, "grazing")
        assert point.value == pytest.approx(0.25, rel=1e-9)
        assert point.status == "stop begins to touch at 0.5 and -0.5" or "stop begins to touch at -0.5" in point.status
        equations = HarmonicBalance(9).equations(system)
        again = hb.trace(equations, point.orbit, "mu", (0.01, 0.5), longest=0.1)
        assert only(again, "grazing").value == pytest.approx(0.25, rel=1e-9) and len(again.special) == 1
        over_the_gap = hb.trace(equations, start, "g", (0.05, 0.6), longest=0.1)  # its radius is 0.2
        assert only(over_the_gap, "grazing").value == pytest.approx(0.2, rel=1e-9)


class TestOnset:
    def test_smooth(self):
        """Bautin: subcritical for a > 0, supercritical for a < 0."""
        for a, wanted in ((1.0, "subcritical"), (-1.0, "supercritical")):
            system = hb.load_problem("bautin").bautin(a=a)
            branch = traced(system, "mu", (-0.3, 0.3), 3)
            assert only(branch, "hopf").criticality == wanted
            assert "Lyapunov" in only(branch, "hopf").status
            assert (branch.values[1] < 0) == (wanted == "subcritical")

    def test_dead_band(self, branch):
        """The hunting branch turns back to lower speeds: below contact the bogie is linear."""
        hopf = only(branch, "hopf")
        assert hopf.criticality == "subcritical" and "V falls" in hopf.status

    def test_a_branch_of_one_point_does_not_tell_the_onset(self):
        """Duffing's equation is conservative at d = 0: there is no Lyapunov coefficient, and no neighbour."""
        system = hb.load_problem("duffing").duffing()
        (hopf,) = hb.hopf_points(system, "d", (-0.5, 0.5))
        assert onset(hopf, system.with_parameters(d=hopf.value), [hopf.value]) is hopf


class TestShifted:
    @pytest.mark.parametrize("shift", [5.0, -5.0, 0.0])
    def test_direction_from_a_hopf_point_away_from_zero(self, shift):
        """The mean moves along the branch, too: growing is the amplitude, whatever the mean does."""
        x, y, mu = Coordinate("x"), Coordinate("y"), Parameter("mu", 0.1)
        u = x + shift
        s = u**2 + y**2
        system = System(
            "shifted", [x, y], [mu], [x.dot - (mu * u - y + 0.3 * u**2 - u * s), y.dot - (u + mu * y - y * s)]
        )
        branch = traced(system, "mu", (-0.5, 0.5))
        assert branch.values[-1] == pytest.approx(0.5) and branch.first_harmonic("x")[-1] > 0.5
        assert only(branch, "hopf").criticality == "supercritical"

    def test_fitzhugh_nagumo(self):
        """T = 39.4744 at I = 0.5, by integration to 1e-12 and Newton's method on the period."""
        v, w, current = Coordinate("v"), Coordinate("w"), Parameter("I", 0.5)
        system = System(
            "FitzHugh-Nagumo",
            [v, w],
            [current],
            [v.dot - (v - v**3 / 3 - w + current), w.dot - (v + 0.7 - 0.8 * w) / 12.5],
        )
        (cycle,) = hb.find_cycles(system, I=0.5)
        assert cycle.period == pytest.approx(39.4744, abs=1e-2)
        assert cycle.stability.verdict == "stable"


@pytest.mark.parametrize(("H", "tolerance"), [(5, 1e-10), (9, 1e-10), (9, 1e-12), (15, 1e-12)])
def test_branch_point_of_coupled_oscillators(H, tolerance):
    """Two coupled van der Pol oscillators: where their cycle in phase meets another branch a verdict changes."""
    x, y, mu = Coordinate("x"), Coordinate("y"), Parameter("mu", 0.5)
    pull = 0.3 * (x - y) + 0.2 * (x - y) ** 3
    system = System(
        "two", [x, y], [mu], [x.ddot - (mu - x**2) * x.dot + x + pull, y.ddot - (mu - y**2) * y.dot + y - pull]
    )
    hopf = min(hb.hopf_points(system, "mu", (-1.0, 2.0)), key=lambda h: h.omega)  # in phase the coupling is slack
    branch = hb.trace(HarmonicBalance(H).equations(system), hopf, "mu", (-1.0, 2.0), tolerance=tolerance)
    assert only(branch, "branch point").value == pytest.approx(1.374, abs=0.01)
    assert "not located" not in {s.kind for s in branch.special}


def on_a_circle(rate, start: float, mu: float) -> tuple[System, hb.Orbit]:
    """Cycles r = 1 + e on which mu is a function of s = r^2: the rate of growth is mu minus that."""
    x, y, m = Coordinate("x"), Coordinate("y"), Parameter("mu", mu)
    growth = m - rate(x**2 + y**2)
    system = System("circles", [x, y], [m], [x.dot - x * growth + y, y.dot - y * growth - x])
    c = np.zeros((3, 2))
    c[1, 0] = c[2, 1] = np.sqrt(start)
    return system, hb.Orbit(system.name, ("x", "y"), ("", ""), c, 1.0, {"mu": mu})


class TestStartOnASpecialPoint:
    """A branch is the same wherever one begins to follow it, on its special points as well."""

    def test_fold_in_closed_form(self):
        """Bautin: mu = r^4 - r^2 is smallest, -1/4, at r^2 = 1/2, the orbit from which the branch is followed."""
        system = hb.load_problem("bautin").bautin()
        equations = HarmonicBalance(3).equations(system)
        first = traced(system, "mu", (-0.3, 0.3), 3)
        for start in (hb.fold(equations, first.folds()[0], "mu").orbit, first.folds()[0].orbit):
            again = hb.trace(equations, start, "mu", (-0.3, 0.3))
            assert [s.kind for s in again.special] == ["fold"]
            assert again.folds()[0].value == pytest.approx(-0.25, abs=1e-12)
            assert len({id(o) for o in again.orbits}) == len(again)
            verdicts = [v for v in again.verdicts if v != "unknown"]
            assert {verdicts[0], verdicts[-1]} == {"stable", "unstable"}

    def test_bogie(self, balance, branch):
        """At the fold, and at the grazing of the rear flange; where the linear cycles end there is no fold."""
        wanted = sorted((s.kind, s.value) for s in branch.special if s.kind != "hopf")
        for start in (branch.folds()[0], branch.special[2]):
            again = hb.trace(balance, start.orbit, "V", (60.0, 190.0), stability=start.kind != "fold")
            if start.kind == "fold":
                assert [s.value for s in again.special] == pytest.approx([start.value], rel=1e-10)
                continue
            found = sorted((s.kind, s.value) for s in again.special)
            assert [k for k, _ in found] == [k for k, _ in wanted]
            assert [v for _, v in found] == pytest.approx([v for _, v in wanted], rel=1e-9)

    @pytest.mark.parametrize("kind", ["fold", "Neimark-Sacker", "period doubling"])
    def test_circuit(self, biased, kind):
        equations = HarmonicBalance(25).equations(circuit.circuit(**circuit.BIASED))
        again = hb.trace(equations, only(biased, kind).orbit, "v", (-0.65, -0.5))
        for s in biased.special:
            if s.kind != "hopf":
                assert only(again, s.kind).value == pytest.approx(s.value, rel=1e-9)
        assert len(again.special) == len(biased.special) - 1

    def test_pitchfork(self, symmetric):
        """Another branch crosses there, once, and the change of stability is explained by it."""
        equations = HarmonicBalance(15).equations(circuit.circuit(**circuit.SYMMETRIC))
        point = only(symmetric, "pitchfork")
        again = hb.trace(equations, point.orbit, "v", (-0.6, -0.58))
        assert [s.value for s in again.special if abs(s.value - point.value) < 1e-6] == pytest.approx([point.value])
        assert "not located" not in {s.kind for s in again.special}


class TestFlatStretches:
    @pytest.mark.parametrize("power", [2, 4, 8])
    def test_a_polynomial_of_even_powers_has_one_fold(self, power):
        """mu = (s - 1)^n: the smallest value, 0, at s = 1, with hardly a slope over many points."""
        system, start = on_a_circle(lambda s: (s - 1) ** power, 1.2, 0.2**power)
        branch = hb.trace(HarmonicBalance(3).equations(system), start, "mu", (-0.1, 0.1), step=0.01, longest=0.01)
        (fold,) = branch.special
        assert fold.kind == "fold" and abs(fold.value) < 1e-13
        assert fold.interval[0] <= 0 <= fold.interval[1]

    def test_a_slope_that_is_round_off(self):
        """(s - 1)^8 written out: terms of up to 70 cancel, and the slope is noise of both signs over many points."""
        expanded = hb.model.Polynomial((1.0, -8.0, 28.0, -56.0, 70.0, -56.0, 28.0, -8.0, 1.0))
        system, start = on_a_circle(expanded.force, 1.02, 0.02**8)
        equations = HarmonicBalance(3).equations(system)
        branch = hb.trace(equations, start, "mu", (-0.1, 0.05**8), step=5e-4, longest=5e-4)
        (fold,) = branch.folds()
        assert "varies too little" in fold.status and abs(fold.value) < 1e-13
        assert fold.interval[1] - fold.interval[0] > 1e-15  # of the size of the round-off, not of the tolerance

    def test_odd_powers_do_not(self):
        """mu = (s - 1)^9 rises all the way."""
        system, start = on_a_circle(lambda s: (s - 1) ** 9, 1.2, 0.2**9)
        branch = hb.trace(HarmonicBalance(3).equations(system), start, "mu", (-0.1, 0.1), step=0.01, longest=0.01)
        assert branch.special == () and min(branch.values) == pytest.approx(-0.1)

    def test_canard_of_fitzhugh_nagumo(self):
        """The branch turns at I = 0.3241785 within a canard explosion: unstable cycles on the one side, stable ones on
        the other, and with enough harmonics one fold between them."""
        v, w, current = Coordinate("v"), Coordinate("w"), Parameter("I", 0.5)
        equations = [v.dot - (v - v**3 / 3 - w + current), w.dot - 0.08 * (v + 0.7 - 0.8 * w)]
        system = System("FitzHugh-Nagumo", [v, w], [current], equations)
        (hopf,) = hb.hopf_points(system, "I", (0.0, 0.4))
        branch = hb.trace(
            HarmonicBalance(100).equations(system), hopf, "I", (0.32, 0.34), stability=False, max_points=60
        )
        (fold,) = branch.folds()
        assert fold.value == pytest.approx(min(branch.values), abs=1e-12)
        assert fold.value == pytest.approx(0.32417852, abs=1e-7)
        first, last = branch.orbits[3], branch.orbits[-1]
        assert hb.floquet(system, first).verdict == "unstable" and hb.floquet(system, last).verdict == "stable"
