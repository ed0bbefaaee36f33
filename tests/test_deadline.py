"""Limits: of time, which leave what was found and say so, and of harmonics, told before anything is built."""

from __future__ import annotations

import time

import pytest

import hbbogie as hb
from hbbogie.deadline import time_is_over, time_limit

PAST = 1e-9  # s, over before any work begins


def test_limits_hold_inside_their_block_and_the_shorter_one_first():
    assert not time_is_over()
    with time_limit(60.0):
        assert not time_is_over()
        with time_limit(PAST):
            time.sleep(1e-3)
            with time_limit(60.0), time_limit(None):
                assert time_is_over()
        assert not time_is_over()


@pytest.mark.parametrize("seconds", [0, -1.0, float("nan"), float("inf"), "10", True])
def test_a_limit_is_a_positive_number(bogie, seconds):
    with pytest.raises(hb.ModelError, match="limit: got"):
        hb.critical_speeds(bogie, "V", (60.0, 100.0), limit=seconds)


def test_a_branch_ends_at_its_limit(bogie, balance):
    (hopf,) = hb.hopf_points(bogie, "V", (60.0, 120.0))
    branch = hb.trace(balance, hopf, "V", (60.0, 120.0), limit=PAST)
    assert [end.kind for end in branch.ends] == ["began", "limit"] and not branch.ends[1].complete
    assert "the time limit was reached at V = 90.97" in str(branch.ends[1]) and len(branch) == 1
    whole = hb.trace(balance, hopf, "V", (60.0, 120.0), limit=600.0, stability=False)
    assert whole.ends[1].kind == "interval" and whole.ends[1].complete


def test_folds_of_a_branch_that_took_all_the_time_are_kept(bogie, monkeypatch):
    """ORDER: with 9 harmonics the fold lies at 88.760 m/s, with all of them at 88.764 m/s."""
    looks = iter([False])  # the first time that the search looks there is time, and none afterwards
    monkeypatch.setattr("hbbogie.critical.search.time_is_over", lambda: next(looks, True))
    monkeypatch.setattr("hbbogie.critical.speeds.time_is_over", lambda: True)
    found = hb.critical_speeds(bogie, "V", (60.0, 100.0), method="mhb")
    (fold,) = (c for c in found if c.kind == "fold")
    assert fold.value == pytest.approx(88.762, abs=3e-3) and not fold.gradient
    assert "no gradient: the time limit was reached" in fold.status and not found.complete


def test_shooting_ends_at_its_limit():
    system = hb.load_problem("van_der_pol").van_der_pol()
    (cycle,) = hb.find_cycles(system, mu=1.0)
    near = cycle.replace(omega=1.01 * cycle.omega)
    assert hb.verify(system, near).orbit.omega == pytest.approx(cycle.omega, rel=1e-8)
    with time_limit(PAST), pytest.raises(hb.ConvergenceError, match="time limit was reached while shooting"):
        hb.verify(system, near)


def test_cycles_found_within_the_limit_are_returned(bogie):
    none = hb.find_cycles(bogie, V=90.0, limit=PAST)
    assert not none and not none.complete and "time limit" in none.undecided[0] and "time limit" in none.evidence[0]
    van_der_pol = hb.load_problem("van_der_pol").van_der_pol()
    (cycle,) = found = hb.find_cycles(van_der_pol, mu=1.0, limit=600.0)
    assert found.complete and cycle.period == pytest.approx(6.66328685932313, rel=1e-6)


@pytest.mark.parametrize("harmonics", [10**4, 10**7, 10**12, 10**40])
def test_too_many_harmonics_are_refused_at_once(bogie, harmonics):
    van_der_pol = hb.load_problem("van_der_pol").van_der_pol()
    begin = time.perf_counter()
    for call in (
        lambda: hb.HarmonicBalance(harmonics).equations(bogie),
        lambda: hb.HarmonicBalance(harmonics).equations(van_der_pol),
        lambda: hb.find_cycles(bogie, V=90.0, harmonics=harmonics),
        lambda: hb.critical_speeds(bogie, "V", (60.0, 100.0), harmonics=harmonics),
    ):
        with pytest.raises(
            hb.ModelError, match=r"GB of memory and .* to build; the limit is 4 GB. Give at most 1\d\d\d"
        ):
            call()
    assert time.perf_counter() - begin < 2.0


def test_as_many_harmonics_as_the_message_allows_are_accepted():
    circuit = hb.load_problem("circuit").circuit()
    with pytest.raises(hb.ModelError, match="Give at most") as refused:
        hb.HarmonicBalance(5000).check(circuit)
    most = int(str(refused.value).partition("Give at most ")[2].partition(".")[0])
    hb.HarmonicBalance(most - 1).check(circuit)
    with pytest.raises(hb.ModelError):
        hb.HarmonicBalance(most + 2).check(circuit)
