"""Piecewise-linear elements in collocation: their contact times are points of the mesh."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.collocation import Collocation, collocated, from_motion
from hbbogie.exact import Exact
from hbbogie.model import CoulombFriction, DeadBand

X, MU = hb.Coordinate("x"), hb.Parameter("mu", 1.0)


@pytest.fixture(scope="module")
def stopped() -> hb.System:
    """Van der Pol's oscillator between stops: smooth nonlinear terms beside a contact."""
    stop = hb.Element("stop", DeadBand(5.0, 1.5), X)
    return hb.System("stopped", [X], [MU], [X.ddot - MU * (1 - X**2) * X.dot + X + stop], [stop])


def test_cycles_of_the_bogie_are_the_exact_ones(bogie, cycles_at_90):
    """The unstable cycle touches with one wheelset, the stable one with both, within a fraction of a millisecond."""
    equations = Collocation().equations(bogie)
    for orbit in cycles_at_90:
        exact, cycle = hb.solve(Exact().equations(bogie), orbit), equations.cycle(orbit)
        assert cycle.period == pytest.approx(exact.period, rel=1e-9)
        assert cycle.period_error < 1e-9 and len(cycle.values) < 100
        assert cycle.amplitude("q1") == pytest.approx(exact.amplitude("q1"), rel=1e-6)
        assert cycle.stability.verdict == exact.stability.verdict
        largest = (np.sort(np.abs(s.multipliers))[-3:] for s in (cycle.stability, exact.stability))
        assert next(largest) == pytest.approx(next(largest), rel=1e-7)


def test_contacts_beside_smooth_nonlinear_terms(stopped):
    """Multiple shooting with located contacts is the truth; the order of the period is that of smooth systems."""
    cycle = collocated(stopped, from_motion(stopped, [2.0, 0.0]), tolerance=1e-11)
    truth = hb.verify(stopped, cycle.orbit())
    assert cycle.period == pytest.approx(truth.orbit.period, rel=1e-11)
    assert cycle.amplitude("x") == pytest.approx(truth.amplitudes["x"], rel=1e-9)
    assert cycle.stability.critical == pytest.approx(truth.orbit.stability.critical, rel=1e-8)
    errors = []
    for N in (32, 64):
        coarse = collocated(stopped, cycle, degree=3, intervals=N)
        errors.append(abs(coarse.period / truth.orbit.period - 1))
    assert np.log2(errors[0] / errors[1]) > 5.0


def test_contact_times_are_points_of_the_mesh(stopped):
    cycle = collocated(stopped, from_motion(stopped, [2.0, 0.0]))
    at_points = np.abs(np.abs(cycle.q(cycle.mesh * cycle.period)[:, 0]) - 1.5)
    assert np.count_nonzero(at_points < 1e-10) == 4


@pytest.fixture(scope="module")
def around_the_fold(bogie, cycles_at_90) -> hb.Branch:
    return hb.trace(Collocation().equations(bogie), cycles_at_90[1], "V", (88.5, 91.2))


def test_branch_of_the_bogie_around_its_fold(bogie, around_the_fold):
    """The exact cycles are the truth on both sides of the fold, 88.7641131943 m/s, and of the grazing next to it."""
    branch, exact = around_the_fold, Exact().equations(bogie)
    (fold,) = branch.folds()
    assert fold.value == pytest.approx(88.7641131943, abs=1e-8)
    touching = [o for o in branch.orbits if o.amplitude("q1") > 0.0093 and abs(o.parameters["V"] - fold.value) > 1e-4]
    assert len(touching) > 8
    for orbit in touching[:: len(touching) // 4]:
        assert orbit.omega == pytest.approx(exact.solve(orbit, V=orbit.parameters["V"]).omega, rel=1e-9)
    assert {"stable", "unstable"} <= set(branch.verdicts)


def test_the_last_contact_is_lost_in_a_grazing(around_the_fold):
    """Beyond it the system is linear: cycles of all amplitudes at one value, after a few of which the branch ends."""
    end = around_the_fold.ends[0] if "family" in str(around_the_fold.ends[0]) else around_the_fold.ends[1]
    assert end.kind == "family"
    assert "V = 90.973978" in str(end)


def test_grazings_are_those_of_the_exact_branch(bogie, cycles_at_90, around_the_fold):
    """The rear wheelset's 88.76994 m/s, and the front one's, with which the nonlinear branch begins."""
    exact = hb.trace(Exact().equations(bogie), cycles_at_90[1], "V", (88.5, 91.2))
    truth, found = (sorted(s.value for s in b.special if s.kind == "grazing") for b in (exact, around_the_fold))
    assert found == pytest.approx(truth, abs=1e-8)
    assert truth[0] == pytest.approx(88.76994, abs=5e-6)


def test_a_contact_at_the_beginning_of_the_period_takes_no_more_intervals(around_the_fold):
    """Beside it is a tiny interval, whose round-off is no error; on the stable part it passes the beginning."""
    intervals = np.array([len(orbit.motion.mesh) - 1 for orbit in around_the_fold.orbits])
    assert intervals.max() < 1.6 * np.median(intervals)


def test_fold_of_the_bogie_with_its_gradient(bogie, around_the_fold):
    near = around_the_fold.folds()[0]
    assert near.value == pytest.approx(88.7641131943, abs=1e-9)
    found, exact = (hb.fold(m.equations(bogie), near, "V") for m in (Collocation(), Exact()))
    assert found.value == pytest.approx(exact.value, rel=1e-9)
    size = max(abs(exact.gradient[k] * bogie.values[k]) for k in exact.gradient)
    for name, slope in exact.gradient.items():
        assert found.gradient[name] * bogie.values[name] == pytest.approx(slope * bogie.values[name], abs=1e-7 * size)


def test_a_branch_past_a_grazing():
    """Beyond a gap of 2.00861986087, the peak of van der Pol's free cycle at mu = 1, its period is free of the gap."""
    gap = hb.Parameter("gap", 1.7)
    stop = hb.Element("stop", DeadBand(5.0, gap), X)
    system = hb.System("stopped", [X], [MU, gap], [X.ddot - MU * (1 - X**2) * X.dot + X + stop], [stop])
    equations = Collocation().equations(system)
    start = equations.cycle(from_motion(system, [2.0, 0.0])).orbit()
    branch = hb.trace(equations, start, "gap", (1.6, 2.3))
    assert [end.kind for end in branch.ends] == ["interval", "interval"]
    (grazing,) = branch.special
    assert grazing.kind == "grazing" and grazing.value == pytest.approx(2.00861986087484314, abs=1e-8)
    assert grazing.status == "stop touches for the last time at 2.00862 and -2.00862"
    for orbit in branch.orbits:
        free = orbit.parameters["gap"] > 2.00861986087484314
        assert (abs(orbit.period / 6.66328685932313019 - 1) < 1e-8) == free
        assert orbit.errors["omega"] < 1e-8 * orbit.omega
    for value in (1.6, 1.95):
        near = min(branch.orbits, key=lambda o: abs(o.parameters["gap"] - value))
        truth = hb.verify(system, near)
        assert near.period == pytest.approx(truth.orbit.period, rel=1e-8)


def test_what_is_refused():
    friction = hb.Element("friction", CoulombFriction(0.1), X.dot)
    dry = hb.System("dry", [X], [MU], [X.ddot - MU * (1 - X**2) * X.dot + X + friction], [friction])
    with pytest.raises(hb.ModelError, match="element 'friction' jumps"):
        Collocation().equations(dry)
