"""Piecewise-linear elements in collocation: their contact times are points of the mesh."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.collocation import Collocation, Rates, collocated, from_motion
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


def test_what_is_refused(bogie, cycles_at_90, stopped):
    with pytest.raises(hb.ModelError, match=r'for a branch.*piecewise linear; take the method "exact"'):
        hb.trace(Collocation().equations(bogie), cycles_at_90[0], "V", (60.0, 190.0))
    with pytest.raises(hb.ModelError, match="for a branch"):
        Rates(stopped, "mu")
    friction = hb.Element("friction", CoulombFriction(0.1), X.dot)
    dry = hb.System("dry", [X], [MU], [X.ddot - MU * (1 - X**2) * X.dot + X + friction], [friction])
    with pytest.raises(hb.ModelError, match="element 'friction' jumps"):
        Collocation().equations(dry)
