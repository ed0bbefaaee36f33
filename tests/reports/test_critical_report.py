"""Critical values as tables and sentences."""

from __future__ import annotations

import pytest

import hbbogie as hb
from hbbogie.critical import coexistence
from hbbogie.reports import critical_of


def report_of(name, **options):
    module = hb.load_problem(name)
    return critical_of(module, module.SYSTEM(), **options)


def table(report, name):
    return next(t for t in report.tables if t.name == name)


@pytest.mark.parametrize(("name", "figures"), [("bautin", {"tornado"}), ("duffing", set())])
def test_a_critical_value_of_zero_has_no_elasticity(name, figures):
    """SOLVER: both Hopf points lie at 0; the fold of bautin at -a^2 / 4 has the elasticity 2."""
    report = report_of(name)
    gradients = table(report, "gradients")
    assert all(row[-1] is None for row in gradients.rows)
    assert set(report.figures) == figures and not any("-0 " in note for note in report.notes)
    assert not any(cell.strip() == "-0" for t in report.tables for row in t.cells() for cell in row)
    if figures:
        assert gradients.rows[0][0] == "a" and gradients.rows[0][4] == pytest.approx(2.0, rel=1e-9)
        report.figures["tornado"]()


def test_no_coexistence_where_rest_is_unstable(bogie):
    """Beside the second and third Hopf point of the bogie the straight run is unstable on both sides."""
    (both,) = coexistence(bogie, hb.critical_speeds(bogie, "V", (60.0, 280.0), harmonics=15))
    assert both.interval == pytest.approx((88.763, 90.974), abs=1e-3)


def test_coexistence_up_to_a_hopf_point_beyond_the_interval(bogie):
    critical = hb.critical_speeds(bogie, "V", (60.0, 89.5), harmonics=15)
    assert [c.kind for c in critical] == ["fold"]
    (both,) = coexistence(bogie, critical)
    assert both.interval == pytest.approx((88.763, 90.974), abs=1e-3) and len(both.thresholds) == 7


def test_coexistence_above_the_hopf_point():
    """SOLVER: growth -mu + R - R^2: the fold, a maximum at 1/4, lies above the Hopf point at 0."""
    x, y, mu = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("mu", 0.0)
    rate = x**2 + y**2 - (x**2 + y**2) ** 2 - mu
    system = hb.System("mirrored", [x, y], [mu], [x.dot - x * rate + y, y.dot - y * rate - x])
    (both,) = coexistence(system, hb.critical_speeds(system, "mu", (-0.5, 0.5), harmonics=5), harmonics=5)
    assert both.interval == pytest.approx((0.0, 0.25), abs=1e-8)
    for cycle in both.thresholds:
        radius = (1 - (1 - 4 * cycle.parameters["mu"]) ** 0.5) / 2
        assert cycle.amplitude("x") == pytest.approx(radius**0.5, rel=1e-8)
    assert len(both.thresholds) == 7


def test_the_same_critical_values_give_one_interval_for_one_branch_with_unstable_cycles(bogie):
    """The thresholds are saddles: one multiplier is outside the unit circle, and the branches followed serve again."""
    found = hb.critical_speeds(bogie, "V", (60.0, 120.0), harmonics=15)
    assert found.branches
    (both,) = coexistence(bogie, found)
    (alone,) = coexistence(bogie, list(found))  # whose branch is traced
    assert both.interval == alone.interval and both.fold is found[0]
    for ours, theirs in zip(both.thresholds, alone.thresholds, strict=True):
        assert ours.omega == pytest.approx(theirs.omega, rel=1e-9)
        assert ours.stability.unstable == 1


def test_lowest_folds_without_groups(bogie):
    found = hb.critical_speeds(bogie, "V", (60.0, 120.0), harmonics=5)
    assert list(found.lowest) == [""] and found.lowest[""] is found[0] and found[0].moves == ""
    assert "lowest" not in {t.name for t in report_of("yang1995", method="mhb").tables}
