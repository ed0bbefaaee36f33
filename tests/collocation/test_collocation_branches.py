"""Branches by collocation: folds, bifurcations, homoclinic approach, and agreement with harmonic balance."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest
from known_cycles import lure
from smooth_systems import brusselator, fitzhugh_nagumo, hodgkin_huxley, lorenz, morris_lecar, roessler

import hbbogie as hb
from hbbogie import Collocation, HarmonicBalance, ModelError, load_problem
from hbbogie.branches import Changing, bifurcation_diagram
from hbbogie.collocation import Rates, collocated, follow, from_motion


def test_canard_fold_of_fitzhugh_nagumo():
    """One fold a side, I = 0.3241785225 and its mirror image; its gradient is that of the fold at another eps."""
    system = fitzhugh_nagumo()
    guess = from_motion(system, [1.0, 1.0])
    followed = follow(guess, Rates(system, "I"), (0.2, 0.6))
    (fold,) = followed.special()
    assert fold.kind == "fold"
    assert fold.value == pytest.approx(0.3241785225, abs=5e-11)
    assert fold.extremum == "minimum"
    assert followed.ends[0].kind == "vanishes"
    assert followed.values[0] == pytest.approx(0.331281, abs=1e-6)  # the Hopf point
    values, step = [], 1e-4
    for eps in (0.08 - step, 0.08 + step):
        there = fitzhugh_nagumo(eps=eps)
        (other,) = follow(from_motion(there, [1.0, 1.0]), Rates(there, "I"), (0.2, 0.6)).special(("fold",))
        values.append(other.value)
    assert fold.gradient["eps"] == pytest.approx((values[1] - values[0]) / (2 * step), rel=1e-5)


@pytest.mark.parametrize("name", ["van der Pol", "FitzHugh-Nagumo"])
def test_error_said_at_a_point_is_its_own(name):
    """The true one, by a tighter tolerance, is at most a fifth larger: also between adaptions and next to a fold."""
    if name == "van der Pol":
        system, parameter, span = load_problem("van_der_pol").van_der_pol(mu=1.0), "mu", (0.8, 6.0)
    else:
        system, parameter, span = fitzhugh_nagumo(), "I", (0.324, 0.5)
    start = collocated(system, from_motion(system, [2.0, 0.0])).orbit()
    branch = hb.trace(Collocation().equations(system), start, parameter, span, stability=False)
    tight = Collocation(tolerance=1e-11).equations(system)
    away = [o for o in branch.orbits if abs(o.parameters[parameter] - 0.3241785225) > 1e-5]  # else another is near
    for orbit in [o for o in away if np.ptp(o.extremes, axis=0)[0] > 0.5][1:-1:4]:  # small ones meet round-off first
        truth = tight.solve(orbit, **{parameter: orbit.parameters[parameter]})
        assert abs(orbit.omega / truth.omega - 1) <= 1.2 * orbit.errors["omega"] / orbit.omega + 1e-11


def test_folds_of_morris_lecar():
    """88.293, and 216.8998: DOP853 at 1e-9 stays on the cycle at 216.8995 and leaves it at 216.9005."""
    system = morris_lecar(g_ca=4.4, v3=2.0, v4=30.0, phi=0.04, current=90.0)
    guess = collocated(system, from_motion(system, [0.0, 0.1]))
    assert guess.period == pytest.approx(102.7272, abs=2e-4)
    followed = follow(guess, Rates(system, "I"), (0.0, 300.0))
    low, high = followed.special(("fold",))
    assert low.value == pytest.approx(88.293, abs=5e-4)
    assert high.value == pytest.approx(216.9, abs=5e-4)
    assert [end.kind for end in followed.ends] == ["vanishes", "vanishes"]
    assert followed.values[[0, -1]] == pytest.approx([93.857618, 212.018816], rel=1e-5)
    periods = sorted(cycle.period for _, cycle in followed.crossings(90.0))
    assert periods == pytest.approx([102.7272, 103.8432], abs=2e-4)


def test_homoclinic_approach():
    """The period grows to ten thousand times that of the start, near I = 35.0067, and the saddle is named."""
    system = morris_lecar(g_ca=4.0, v3=12.0, v4=17.4, phi=0.23, current=37.0)
    followed = follow(from_motion(system, [0.0, 0.1]), Rates(system, "I"), (20.0, 60.0))
    assert followed.ends[0].kind == "homoclinic"
    assert "homoclinic approach near I = 35.0067" in str(followed.ends[0])
    assert "equilibrium v = -22.3" in str(followed.ends[0])
    assert followed.periods[0] > 1e5
    assert followed.values[0] == pytest.approx(35.0067, abs=5e-5)
    assert [s.kind for s in followed.special()] == ["fold"]  # a planar system has no period doubling


@pytest.mark.slow
def test_unstable_cycle_of_hodgkin_huxley():
    """At I = 8.5 the cycle that begins at the Hopf point 9.779637995 has the period 12.62222; three folds follow."""
    system = hodgkin_huxley()
    (hopf,) = hb.hopf_points(system, "I", (5.0, 50.0))
    equations = Collocation().equations(system)
    branch = hb.trace(equations, hopf, "I", (5.0, 12.0), stability=False)
    folds = sorted(s.value for s in branch.folds())
    assert folds == pytest.approx([6.25, 7.85, 7.92], abs=0.03)
    near = min(branch.orbits, key=lambda o: abs(o.parameters["I"] - 8.5) + abs(o.period - 12.6))
    orbit = hb.solve(equations, near, I=8.5)
    assert orbit.period == pytest.approx(12.62222, abs=5e-6)
    assert orbit.stability.verdict == "unstable"


def test_mirror_images_of_lorenz():
    """Period .764386 and multiplier 1.16 at r = 22, on the branches of both Hopf points."""
    system = lorenz()
    found = []
    for hopf in hb.hopf_points(system, "r", (20.0, 30.0)):
        branch = hb.trace(Collocation().equations(system), hopf, "r", (22.0, 30.0), max_points=60)
        assert branch.special[0].criticality == "subcritical"
        last = branch.orbits[-1]
        assert last.parameters["r"] == pytest.approx(22.0)
        assert last.period == pytest.approx(0.764386, abs=5e-7)
        assert last.stability.critical.real == pytest.approx(1.16, abs=5e-3)
        found.append(last.coefficients[0, 0])
    assert found[0] == pytest.approx(-found[1], rel=1e-6)


def test_period_doublings():
    """Roessler's first one, located by two functions; that of Lur'e's system at 0.63030200616."""
    system = roessler()
    guess = collocated(system, from_motion(system, [1.0, 1.0, 0.0]))
    (doubling,) = follow(guess, Rates(system, "c"), (2.2, 3.0)).special()
    assert doubling.kind == "period doubling"
    assert np.abs(doubling.cycle.stability.multipliers + 1).min() < 1e-8
    system, orbit = lure()
    branch = hb.trace(Collocation().equations(system), orbit, "alpha", (0.6, 0.66))
    (doubling,) = [s for s in branch.special if s.kind == "period doubling"]
    assert doubling.value == pytest.approx(0.63030200616, abs=1e-9)


def test_branches_that_begin_at_special_points():
    """PUBLISHED pitchfork of the symmetric circuit; beyond it lie two asymmetric cycles. Roessler's doubled cycles."""
    circuit = load_problem("circuit")
    system = circuit.circuit(**circuit.SYMMETRIC)
    equations = Collocation().equations(system)
    (hopf, *_) = hb.hopf_points(system, "v", (-0.65, -0.57))
    symmetric = hb.trace(equations, hopf, "v", (-0.6, -0.57))
    (fork,) = (s for s in symmetric.special if s.kind == "pitchfork")
    assert fork.value == pytest.approx(-0.587028974, abs=5e-10)
    broken = hb.trace(equations, fork, "v", (-0.6, -0.57))
    one, other = broken.orbits[0], broken.orbits[-1]
    assert one.parameters["v"] == other.parameters["v"] == pytest.approx(-0.6)
    assert one.mean("x") == pytest.approx(-other.mean("x"), rel=1e-6) and abs(one.mean("x")) > 0.05
    assert one.omega == pytest.approx(other.omega, rel=1e-9)
    system = roessler(c=2.5)
    equations = Collocation().equations(system)
    cycle = equations.cycle(from_motion(system, [1.0, 1.0, 0.0])).orbit()
    (doubling,) = (s for s in hb.trace(equations, cycle, "c", (2.4, 3.0)).special if s.kind == "period doubling")
    doubled = hb.trace(equations, doubling, "c", (2.4, 3.0))
    assert doubled.orbits[0].period == pytest.approx(2 * doubling.orbit.period, rel=1e-2)
    assert doubled.values.min() == pytest.approx(doubling.value, rel=1e-8) and doubled.verdicts[0] == "stable"
    truth = hb.verify(system, doubled.orbits[0])
    assert truth.orbit.omega == pytest.approx(doubled.orbits[0].omega, rel=1e-8)


def test_fold_with_its_gradient_is_that_of_harmonic_balance():
    """Bautin: mu = -a^2 / 4, d mu / d a = -a / 2."""
    system = load_problem("bautin").bautin(a=1.0)
    (hopf,) = hb.hopf_points(system, "mu", (-0.5, 0.5))
    equations = Collocation().equations(system)
    branch = hb.trace(equations, hopf, "mu", (-0.5, 0.5))
    assert branch.verdicts[0] == "unstable"
    assert branch.verdicts[-1] == "stable"
    (special,) = branch.folds()
    other = hb.fold(HarmonicBalance(15).equations(system), special, "mu")
    found = hb.fold(equations, special, "mu")
    assert found.value == pytest.approx(-0.25, abs=1e-9)
    assert found.value == pytest.approx(other.value, abs=1e-9)
    assert found.gradient["a"] == pytest.approx(-0.5, abs=1e-9)
    assert found.extremum == other.extremum == "minimum"
    assert found.curvature > 0


@pytest.mark.parametrize(("name", "start", "span"), [("isola", 0.0, (-4.0, 4.0)), ("bautin", -0.1, (-0.3, 0.2))])
def test_folds_are_those_of_harmonic_balance_in_all_parameters(name, start, span):
    """Newton's method on the bordered equations, also from a cycle of harmonic balance: to 1e-7."""
    module = load_problem(name)
    system, parameter = module.SYSTEM(), module.PARAMETER
    balance = HarmonicBalance(15).equations(system)
    cycle = hb.find_cycles(system, parameter=parameter, **{parameter: start})[0]
    for special in hb.trace(balance, cycle, parameter, span, stability=False).folds():
        truth, found = (hb.fold(e, special, parameter) for e in (balance, Collocation().equations(system)))
        assert found.value == pytest.approx(truth.value, rel=1e-8)
        assert found.extremum == truth.extremum and found.curvature * (1 if truth.extremum == "minimum" else -1) > 0
        size = max(map(abs, truth.gradient.values()))
        assert set(found.gradient) == set(truth.gradient)
        for key, slope in truth.gradient.items():
            assert found.gradient[key] == pytest.approx(slope, abs=1e-7 * size)


@pytest.mark.parametrize("harmonics", [31, 63])
def test_a_branch_changes_over_to_collocation_and_back(harmonics):
    """The canards on both sides take collocation; the folds are mirror images, v and w mirrored at I = 0.875."""
    system, span = fitzhugh_nagumo(), (0.2, 1.6)
    hopf, *_ = hb.hopf_points(system, "I", span)
    branch = Changing(system, "I", span, harmonics, stability=False).trace(hopf)
    methods = [name for name, _ in groupby(orbit.method.split(",")[0] for orbit in branch.orbits)]
    assert methods[:3] == ["harmonic balance", "collocation", "harmonic balance"] == methods[-3:]
    assert [s.value for s in branch.folds()] == pytest.approx([0.3241785225, 2 * 0.875 - 0.3241785225], abs=1e-9)
    assert [end.kind for end in branch.ends] == ["began", "vanishes"]


def test_a_diagram_by_itself_changes_over(tmp_path):
    """Van der Pol's oscillator at mu = 40, where 63 harmonics do not do."""
    system = load_problem("van_der_pol").van_der_pol(mu=1.0)
    found = bifurcation_diagram(system, "mu", (-0.5, 40.0), method="auto", stability=False)
    (branch,) = found.branches.values()
    assert branch.orbits[0].method.startswith("harmonic") and branch.orbits[-1].method.startswith("collocation")
    assert any("go on by collocation" in note for note in found.notes)
    near = branch.orbits[-1]
    assert near.parameters["mu"] == pytest.approx(40.0)
    truth = collocated(system.with_parameters(mu=40.0), from_motion(system.with_parameters(mu=40.0), [2.0, 0.0]))
    assert near.period == pytest.approx(truth.period, rel=1e-8)
    branch.save(tmp_path / "branch.nc")  # cycles of both forms in one file
    assert hb.Branch.load(tmp_path / "branch.nc").orbits[-1].period == near.period


def test_compare():
    system = load_problem("bautin").bautin(a=1.0)
    found = hb.compare(system, ("mhb3", "collocation"), parameter="mu", interval=(-0.5, 0.5))
    assert found.methods["collocation"].fold == pytest.approx(-0.25, abs=1e-9)
    rows = [row for row in found.rows if row.value < 0]
    assert {row.part for row in rows} == {0, 1}
    for row in found.rows:
        assert row.orbits["collocation"].omega == pytest.approx(1.0, rel=1e-9)
        assert row.orbits["collocation"].amplitude("x") == pytest.approx(row.truth.amplitude("x"), rel=1e-6)


def test_find_cycles_of_strong_relaxation():
    """No harmonics resolve these; what the search finds is the true period with a verdict."""
    (cycle,) = hb.find_cycles(load_problem("van_der_pol").van_der_pol(mu=100.0), tolerance=1e-6)
    assert cycle.period == pytest.approx(162.83707109, rel=1e-9)
    assert cycle.stability.verdict == "stable"
    assert cycle.method.startswith("collocation")
    assert cycle.errors["waveform"] < 1e-6 and cycle.kept is None


def test_start_outside_the_interval():
    system = brusselator()
    orbit = collocated(system, from_motion(system, [1.0, 1.0])).orbit()
    with pytest.raises(ModelError, match="outside the interval"):
        hb.trace(Collocation().equations(system), orbit, "a", (1.0, 2.0))


def test_a_branch_closes_on_itself():
    """The isola's radii are the square roots of c +- sqrt(rho^2 - mu^2): its folds lie at -rho and rho."""
    system = hb.load_problem("isola").SYSTEM()
    cycle = hb.find_cycles(system, mu=0.0)[-1]
    branch = hb.trace(Collocation().equations(system), cycle, "mu", (-2.0, 2.0), stability=False)
    assert {end.kind for end in branch.ends} == {"closed"}
    np.testing.assert_allclose(sorted(f.value for f in branch.folds()), [-system.values["rho"], system.values["rho"]])


def test_a_branch_that_passes_near_its_start_goes_on(bogie):
    """The bogie's turns around its fold and passes the speed of the Hopf point, at which it began, at a larger peak."""
    (hopf,) = hb.hopf_points(bogie, "V", (85.0, 95.0))
    branch = hb.trace(Collocation().equations(bogie), hopf, "V", (88.0, 92.5), stability=False)
    assert branch.ends[1].kind == "interval" and branch.values.max() == 92.5
