"""Critical values of many designs at once against those of one design by harmonic balance, and exact branches."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import critical_speeds_of
from hbbogie.errors import ModelError
from hbbogie.exact import at_grazing, follow
from hbbogie.results import ConvergenceError

SPAN = (40.0, 160.0)
NAMES = ("Mw", "Mf", "K1", "K2", "K4", "D2", "lam", "f11")


@pytest.fixture(scope="module")
def points(bogie):
    chosen = hb.studies.latin_hypercube(hb.studies.around(bogie, 0.2, NAMES), 6, seed=11)
    return dict(zip(chosen.names, chosen.values.T, strict=True))


def test_random_bogies_by_two_methods(bogie, points):
    """Two independent methods: 21 harmonics leave out less than 1e-4 of the fold, and nothing of the Hopf point."""
    found = critical_speeds_of(bogie, points, interval=SPAN)
    assert not found.failed.any()
    for d in range(6):
        one = bogie.with_parameters(**{name: values[d] for name, values in points.items()})
        by_kind = {c.kind: c for c in reversed(hb.critical_speeds(one, "V", SPAN))}
        assert found.critical[d] == pytest.approx(min(c.value for c in by_kind.values()), rel=1e-4)
        assert found.hopf[d] == pytest.approx(by_kind["hopf"].value, rel=1e-9)
        assert found.hopf_omega[d] == pytest.approx(by_kind["hopf"].omega, rel=1e-9)
        assert ("fold" in by_kind and by_kind["fold"].value < found.hopf[d]) == np.isfinite(found.fold[d])
        for name in NAMES:
            assert found.hopf_gradient[name][d] == pytest.approx(by_kind["hopf"].gradient[name], rel=1e-6)
            if np.isfinite(found.fold[d]):
                share = bogie.values[name] / found.fold[d]  # gradients as elasticities
                other = by_kind["fold"].gradient[name] * share
                assert found.fold_gradient[name][d] * share == pytest.approx(other, abs=2e-3)


def test_random_bogies_against_their_exact_branches(bogie, points):
    found = critical_speeds_of(bogie, points, interval=SPAN)
    for d in range(6):
        one = bogie.with_parameters(**{name: values[d] for name, values in points.items()})
        hopf = hb.hopf_points(one, "V", SPAN)[0]
        folds = [q.value for q in follow(at_grazing(one, hopf), (SPAN[0], 1.2 * hopf.value)).marked("fold")]
        assert found.fold[d] == pytest.approx(min(v for v in folds if v < hopf.value), rel=1e-9, nan_ok=True)


def test_designs_whose_guesses_are_learnt_from_others(bogie):
    """Of many designs a few are solved for first: the answers are those of each design on its own."""
    rng = np.random.default_rng(5)
    given = {name: bogie.values[name] * rng.uniform(0.8, 1.2, 40) for name in ("lam", "K2")}
    found = critical_speeds_of(bogie, given, interval=SPAN)
    assert np.isfinite(found.fold).all()
    for d in (0, 17, 39):
        own = {name: values[d] for name, values in given.items()}
        alone = critical_speeds_of(bogie.with_parameters(**own), own, interval=SPAN)
        for what in ("fold", "fold_omega", "hopf", "hopf_omega"):
            assert getattr(found, what)[d] == pytest.approx(getattr(alone, what)[0], rel=1e-10)
        for name in NAMES:
            share = bogie.values[name]
            assert found.fold_gradient[name][d] * share == pytest.approx(alone.fold_gradient[name][0] * share, abs=1e-6)


def test_one_number_serves_all_designs(bogie):
    found = critical_speeds_of(bogie, {"lam": [0.048, 0.052], "K2": 9e6}, interval=SPAN)
    assert found.points["K2"].tolist() == [9e6, 9e6] and found.fold.shape == (2,)
    assert found.fold[0] > found.fold[1] and (found.critical == found.fold).all()


def test_a_design_that_never_loses_its_stability(bogie):
    found = critical_speeds_of(bogie, {"lam": [1e-4]}, interval=SPAN)
    assert np.isnan(found.critical[0]) and not found.failed[0] and "no Hopf point" in found.status[0]


def test_what_cannot_be_asked(bogie):
    for points, message in (
        ({"V": [90.0]}, "what is looked for"),
        ({}, "no points are given"),
        ({"lam": []}, "one number for each design"),
        ({"lam": [0.05, 0.06], "K2": [1e6, 2e6, 3e6]}, "one number for each design"),
        ({"lam": [[0.05]]}, "one number for each design"),
        ({"lamda": [0.05]}, "Did you mean 'lam'"),
        ({"lam": [0.05, np.nan]}, "finite number"),
        ({"lam": [0.05, np.inf]}, "finite number"),
        ({"lam": ["much"]}, "no numbers"),
        ({"lam": None}, "finite number"),
        ({"lam": [0.05, 1e300]}, "from"),
        ({"lam": [[0.05], [0.06, 0.07]]}, "no numbers"),
    ):
        with pytest.raises(ModelError, match=message):
            critical_speeds_of(bogie, points, interval=SPAN)
    with pytest.raises(ConvergenceError, match="no Hopf point"):
        critical_speeds_of(bogie, {"lam": [0.05]}, interval=(10.0, 20.0))
    with pytest.raises(ModelError, match="low < high"):
        smooth = hb.load_problem("bautin").bautin()
        critical_speeds_of(smooth, {"a": [1.0]}, parameter="mu", interval=(0.5, -2.0))


def test_designs_of_a_smooth_system_in_closed_form():
    """Bautin's fold lies at -a^2 / 4, and its Hopf point at 0; both are found one design at a time."""
    a = np.array([0.5, 1.0, 1.5])
    found = critical_speeds_of(hb.load_problem("bautin").bautin(), {"a": a}, parameter="mu", interval=(-2.0, 0.5))
    np.testing.assert_allclose(found.fold, -(a**2) / 4, rtol=1e-8)
    np.testing.assert_allclose(found.fold_gradient["a"], -a / 2, rtol=1e-6)
    np.testing.assert_allclose(found.hopf, 0.0, atol=1e-9)
    assert found.complete.all() and not found.failed.any() and (found.critical == found.fold).all()


def test_what_is_said_to_be_complete_was_followed(bogie):
    """From the nominal fold nothing is followed, and the row says so; without a fold all branches were followed."""
    found = critical_speeds_of(bogie, {"lam": [0.05, 0.05], "K2": [10e6, 10e6], "D2": [1e4, 3e4]}, interval=SPAN)
    for d in range(2):
        assert found.complete[d] == ("not followed" not in found.status[d])
        assert np.isfinite(found.fold[d]) or "no fold" in found.status[d]


def test_a_design_that_is_lost_in_closed_form_is_done_by_itself(bogie, monkeypatch):
    """SOLVER: as if all branches had been lost; the answer is that of the search for one design."""
    lost = "it is not known whether there is a fold"
    monkeypatch.setattr("hbbogie.exact.critical._followed", lambda *args: (None, (None, lost, True, False), None))
    monkeypatch.setattr("hbbogie.exact.batch.Nominal.near", lambda nominal, p: {})
    found = critical_speeds_of(bogie, {"lam": [0.05, 0.06]}, interval=SPAN)
    assert not found.failed.any() and found.complete.all() and all(s.startswith(lost) for s in found.status)
    for d, lam in enumerate((0.05, 0.06)):
        (fold, hopf) = hb.critical_speeds(bogie, "V", SPAN, lam=lam)[:2]
        assert found.fold[d] == pytest.approx(fold.value, rel=1e-10)
        assert found.hopf[d] == pytest.approx(hopf.value, rel=1e-10)
        assert found.fold_gradient["K2"][d] == pytest.approx(fold.gradient["K2"], rel=1e-9)
        assert found.hopf_gradient["K2"][d] == pytest.approx(hopf.gradient["K2"], rel=1e-9)


def test_designs_without_a_fold_are_answered_from_one_that_was_followed(bogie):
    """Two independent ways: what is said of designs together is what their branches, each followed, show."""
    lam, low = np.linspace(0.145, 0.155, 6), (10.0, 250.0)
    found = critical_speeds_of(bogie, {"lam": lam}, interval=low)
    carried = ["followed by themselves" in said for said in found.status]
    assert sum(carried) >= 4 and not found.failed.any() and np.isnan(found.fold).all()
    d = carried.index(True)
    alone = hb.critical_speeds(bogie, "V", low, lam=float(lam[d]))
    assert alone[0].kind == "hopf" and alone.complete
    assert found.critical[d] == pytest.approx(alone[0].value, rel=1e-9) and not found.complete[d]


def test_the_lower_of_two_folds_of_one_branch(bogie):
    """Two ways: the branch of this design turns three times below its Hopf point, and its second minimum is lower."""
    values = {"Mw": 638.198, "Mf": 1984.543, "K1": 3868958.84, "K2": 12815522.67, "K4": 201761.098, "K6": 3163005.567}
    values |= {"D2": 32766.5567, "lam": 0.0282226322, "f11": 5234380.6676}
    found = critical_speeds_of(bogie, {name: [value] for name, value in values.items()}, interval=(10.0, 250.0))
    lowest = hb.critical_speeds(bogie, "V", (150.0, 250.0), **values)[0]
    assert lowest.value == pytest.approx(174.2866, abs=1e-3)
    assert found.fold[0] == pytest.approx(lowest.value, rel=1e-9)


def test_a_fold_next_to_its_hopf_point_is_not_lost_beside_a_design_without_one(bogie):
    """Two ways: from lam = 0.1069 on there is none; at 0.1065 the fold lies 3e-9 of its value below the Hopf point."""
    lam, span = [0.10694444, 0.10648148, 0.10601852], (10.0, 250.0)
    found = critical_speeds_of(bogie, {"lam": lam}, interval=span)
    assert np.isnan(found.fold).tolist() == [True, False, False] and not found.failed.any()
    (fold, hopf) = hb.critical_speeds(bogie, "V", span, lam=lam[1])[:2]
    assert 0 < hopf.value - fold.value < 1e-8 * hopf.value
    assert found.fold[1] == pytest.approx(fold.value, rel=1e-11)
