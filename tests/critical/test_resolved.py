"""Folds that are there and folds of the truncated equations only: the canard of FitzHugh and Nagumo."""

from __future__ import annotations

import pytest

import hbbogie as hb
from hbbogie import Coordinate, HarmonicBalance, Parameter, System
from hbbogie.critical import chart

FOLD = 0.3241785225  # by collocation on 400 intervals; one fold only, since the exploding branch does not turn back


@pytest.fixture(scope="module")
def canard() -> System:
    v, w, current, eps = Coordinate("v"), Coordinate("w"), Parameter("I", 0.5), Parameter("eps", 0.08)
    equations = [v.dot - (v - v**3 / 3 - w + current), w.dot - eps * (v + 0.7 - 0.8 * w)]
    return System("FitzHugh-Nagumo", [v, w], [current, eps], equations)


def test_critical_values_that_are_not_resolved_say_so(canard):
    found = hb.critical_speeds(canard, "I", (0.3, 0.4), harmonics=9)
    folds = [c for c in found if c.kind == "fold"]
    assert folds and not any(c.resolved for c in folds if abs(c.value - FOLD) > 1e-6)
    assert all("not resolved" in c.status for c in folds if not c.resolved)
    (hopf,) = (c for c in found if c.kind == "hopf")
    assert hopf.resolved


@pytest.mark.parametrize("stability", [False, True])
def test_along_a_branch_with_and_without_stability(canard, stability):
    (hopf,) = hb.hopf_points(canard, "I", (0.0, 0.4))
    options = {"stability": stability, "max_points": 45}
    branch = hb.trace(HarmonicBalance(15).equations(canard), hopf, "I", (0.32, 0.34), **options)
    assert branch.folds() and not any(s.resolved for s in branch.folds())


@pytest.mark.parametrize("harmonics", [9, 15])
def test_slow_modes_do_not_pass_for_the_multipliers_of_a_fold(harmonics):
    """Two states that follow slowly change no cycle, but have multipliers near 1; 9 and 15 harmonics resolve no fold.

    The one fold of the cycles, by collocation, is at 0.32417852 (see FOLD).
    """
    v, w, current = Coordinate("v"), Coordinate("w"), Parameter("I", 0.33)
    slow, slower = Coordinate("slow"), Coordinate("slower")
    equations = [v.dot - (v - v**3 / 3 - w + current), w.dot - 0.08 * (v + 0.7 - 0.8 * w)]
    system = System("canard", [v, w, slow, slower], [current], [*equations, slow.dot - 2e-3 * (v - slow),
                                                               slower.dot - 1e-3 * (w - slower)])  # fmt: skip
    (hopf,) = hb.hopf_points(system, "I", (0.0, 0.4))
    options = {"stability": False, "max_points": 60}
    branch = hb.trace(HarmonicBalance(harmonics).equations(system), hopf, "I", (0.31, 0.34), **options)
    assert any(abs(s.value - FOLD) > 1e-5 for s in branch.folds())
    assert all(abs(s.value - FOLD) < 1e-5 for s in branch.folds() if s.resolved)
    assert any("not resolved" in line for line in repr(branch).splitlines())


def test_a_chart_says_so(canard):
    found = chart(canard, "I", "eps", (0.079, 0.081), span=(0.32, 0.34), harmonics=9)
    assert any("not resolved" in note for note in found.notes)


def test_a_fold_with_a_closed_form_is_resolved():
    """Bautin: mu = -a^2/4 at the fold."""
    (fold,) = (c for c in hb.critical_speeds(hb.load_problem("bautin").bautin(), "mu", (-0.3, 0.3)) if c.kind == "fold")
    assert fold.resolved and fold.value == pytest.approx(-0.25, abs=1e-9)
