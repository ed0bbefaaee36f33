"""Branches and curves shared among several processes: the results are those of one."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import ModelError
from hbbogie.branches import bifurcation_diagram
from hbbogie.parallel import each, in_processes
from hbbogie.progress import silent


@pytest.fixture(scope="module")
def two_onsets():
    """x'' with damping (v - 1)(v - 3) + v a x^2 - x^4: two Hopf points over v, each with a branch and a fold."""
    x, v, a = hb.Coordinate("x"), hb.Parameter("v", 2.0), hb.Parameter("a", 1.0, bounds=(0.1, 5.0))
    damping = (v - 1) * (v - 3) - a * x**2 + 0.5 * x**4
    return hb.System("two onsets", [x], [v, a], [x.ddot + damping * x.dot + x])


def as_numbers(branch):
    points = [(s.kind, s.value, s.omega) for s in branch.special]
    return branch.values.tolist(), branch.omega.tolist(), branch.verdicts, points, branch.ends


def test_a_diagram_is_the_same(two_onsets):
    one, two = (bifurcation_diagram(two_onsets, "v", (0.0, 4.0), workers=n) for n in (1, 2))
    assert len(one.hopf) == 2
    assert list(one.branches) == list(two.branches) and one.notes == two.notes
    for name, branch in one.branches.items():
        assert as_numbers(branch) == as_numbers(two.branches[name])


def test_a_chart_is_the_same(two_onsets):
    one, two = (hb.chart(two_onsets, "v", "a", (0.5, 2.0), span=(0.0, 4.0), workers=n) for n in (1, 2))
    assert len(one.folds) >= 2 and one.notes == two.notes and one.special == two.special
    for a, b in zip(one.curves, two.curves, strict=True):
        for name in ("values", "over_values", "omega", "slope", "side"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert a.ends == b.ends and a.character == b.character


def quotient(numerator, denominator, progress):
    return numerator // denominator


def test_calls_keep_their_order_and_their_errors():
    said = []
    with in_processes(2):
        assert each(quotient, 12, [(k,) for k in (1, 2, 3, 4)], lambda m, f: said.append(f), "dividing") == [
            12,
            6,
            4,
            3,
        ]
        with pytest.raises(ZeroDivisionError):
            each(quotient, 12, [(1,), (0,)])
    assert said == sorted(said) and said[0] == 0 and said[-1] == 1
    assert each(quotient, 12, [(3,), (4,)], silent) == [4, 3]


@pytest.mark.parametrize("workers", [0, 1.5, "two"])
def test_a_wrong_number_of_processes(two_onsets, workers):
    with pytest.raises(ModelError, match=r"workers.*whole number"):
        bifurcation_diagram(two_onsets, "v", (0.0, 4.0), workers=workers)
