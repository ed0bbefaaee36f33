"""The search for critical values along branches that turn several times, next to Hopf points, and its limits."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import Coordinate, Parameter, System
from hbbogie.exact import at_grazing, follow
from hbbogie.studies import smallest_critical


def rises_then_falls(a: float = 0.4, b: float = 2.0, c: float = 1.6, small: float = 0.2) -> System:
    """x'' + small (-mu + a x^2 - b x^4 + c x^6) x' + x = 0: a branch that rises, turns, falls and turns again.

    Averaged, a cycle of amplitude r has mu = a r^2 / 4 - b r^4 / 8 + 5 c r^6 / 64, right to the order of small^2.
    """
    x, mu = Coordinate("x", "m"), Parameter("mu", -0.1, "1", "", (-300.0, 300.0))
    damping = small * (-mu + a * x**2 - b * x**4 + c * x**6)
    return System("rises then falls", [x], [mu], [x.ddot + damping * x.dot + x])


def averaged(a: float = 0.4, b: float = 2.0, c: float = 1.6) -> tuple[float, float]:
    """Both folds of the averaged branch: the smaller and the larger value of mu."""
    s = np.roots([15 * c / 64, -b / 4, a / 4]).real
    low, high = sorted(a * s / 4 - b * s**2 / 8 + 5 * c * s**3 / 64)
    return float(low), float(high)


@pytest.mark.parametrize("reach", [0.1, 2.0, 200.0])
def test_the_branch_is_followed_on_where_it_first_rises(reach):
    """The fold below the Hopf point lies behind one above it; how wide the interval is does not matter."""
    system = rises_then_falls(small=1e-3)
    found = hb.critical_speeds(system, "mu", (-reach, reach))
    assert [(c.kind, c.extremum) for c in found] == [("fold", "minimum"), ("hopf", ""), ("fold", "maximum")]
    low, high = averaged()
    assert found[0].value == pytest.approx(low, abs=1e-7) and found[2].value == pytest.approx(high, abs=1e-7)
    assert found.complete and len(found.evidence) == 1 and "end of the interval" in found.evidence[0]


@pytest.mark.parametrize("a", [0.3, 0.4, 0.5])
def test_job_and_function_agree(a):
    system = rises_then_falls(a)
    row = smallest_critical(system, "mu", (-2.0, 2.0))
    first = hb.critical_speeds(system, "mu", (-2.0, 2.0), harmonics=15)[0]
    assert row["critical"] == pytest.approx(first.value, rel=1e-12) and row["kind"] == first.kind
    assert row["complete"] == 1 and not row["failed"]
    low, _ = averaged(a)
    assert row["kind"] == ("fold" if low < 0 else "hopf")
    if row["kind"] == "fold":
        assert row["critical"] == pytest.approx(low, abs=0.2**2) and 0 < row["fold_error"] < 1e-9


def test_a_fold_two_millionths_below_the_hopf_point(bogie):
    """Near a conicity of 0.1065 the branch ceases to fall at its onset, and the fold meets the Hopf point."""
    system = bogie.with_parameters(lam=0.1064)
    walk = follow(at_grazing(system, hb.hopf_points(system, "V", (40.0, 90.0))[0]), (40.0, 90.0))
    (exact,) = (point.value for point in walk.marked("fold"))
    row = smallest_critical(system, "V", (20.0, 200.0))
    assert 0 < row["hopf"] - exact < 2e-6
    assert row["kind"] == "fold" and abs(row["critical"] - exact) <= row["fold_error"] < 1e-6


@pytest.fixture(scope="module")
def smooth() -> System:
    return rises_then_falls(small=1.0)


@pytest.fixture(scope="module")
def truth(smooth) -> list[float]:
    return [c.value for c in hb.critical_speeds(smooth, "mu", (-2.0, 2.0), harmonics=31) if c.kind == "fold"]


@pytest.mark.parametrize("harmonics", [3, 5, 9])
def test_the_error_of_a_smooth_fold_is_a_bound(smooth, truth, harmonics):
    found = [c for c in hb.critical_speeds(smooth, "mu", (-2.0, 2.0), harmonics=harmonics) if c.kind == "fold"]
    for fold, value in zip(found, truth, strict=True):
        distance = abs(fold.value - value)
        assert distance <= fold.error <= 20 * distance + 1e-9


def test_a_limit_of_time_leaves_what_was_found():
    found = hb.critical_speeds(rises_then_falls(), "mu", (-2.0, 2.0), limit=1e-9)
    assert not found.complete and "time limit" in found.undecided[0]
    with pytest.raises(hb.ModelError, match="limit: got -1"):
        hb.critical_speeds(rises_then_falls(), "mu", (-2.0, 2.0), limit=-1)


def test_a_fold_below_the_interval_counts_where_its_branch_begins_inside():
    """Bautin: the fold is at mu = -a^2/4, and cycles exist at the beginning of the interval."""
    bautin = hb.load_problem("bautin").bautin()
    found = hb.critical_speeds(bautin, "mu", (-0.2, 0.3))
    assert [c.kind for c in found] == ["fold", "hopf"] and found[0].value == pytest.approx(-0.25, abs=1e-9)
    assert [c.kind for c in hb.critical_speeds(bautin, "mu", (0.1, 0.3))] == []


def test_progress_is_a_growing_share():
    said = []
    hb.critical_speeds(hb.load_problem("bautin").bautin(), "mu", (-1.0, 1.0), progress=lambda m, f: said.append(f))
    assert said[0] == 0 and said == sorted(said) and said[-1] < 1
