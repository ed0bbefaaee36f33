"""What is given to the methods beside harmonic balance is refused with a sentence that says what belongs there."""

from __future__ import annotations

import numpy as np
import pytest
from smooth_systems import fitzhugh_nagumo

import hbbogie as hb
from hbbogie.collocation import Collocation, Rates, collocated, follow, from_motion, from_orbit
from hbbogie.exact import Exact, at_grazing, exact_cycle
from hbbogie.exact import follow as follow_exactly

SYSTEM = fitzhugh_nagumo()
BOGIE = hb.load_problem("yang1995").bogie()


@pytest.fixture(scope="module")
def guess():
    return from_motion(SYSTEM, [1.0, 0.0])


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda g: Exact().equations(None), "got None; give a System"),
        (lambda g: Exact().equations(BOGIE).solve(None), "got None; give an Orbit"),
        (lambda g: exact_cycle(BOGIE, None, "V"), "argument 'orbit': got None; give an Orbit"),
        (lambda g: at_grazing(BOGIE, 90.0), "argument 'hopf': got 90.0; give a special point"),
        (lambda g: follow_exactly(None, (60.0, 190.0)), "argument 'first': got None; give a point of a branch"),
        (lambda g: Collocation(intervals=10).equations(3), "got 3; give a System"),
        (lambda g: Collocation().equations(SYSTEM).solve(3), "got 3; give an Orbit"),
        (lambda g: hb.solve(Collocation().equations(SYSTEM), g), "argument 'guess': got an object of type Sampled"),
        (lambda g: collocated(SYSTEM, None), "argument 'guess': got None; give a guess, as from_motion"),
        (lambda g: collocated(None, g), "argument 'system': got None; give a System"),
        (lambda g: collocated(BOGIE, g), "give a guess that was made with this system"),
        (lambda g: collocated(SYSTEM, g, degree="four"), "degree: got 'four'; give a whole number"),
        (lambda g: collocated(SYSTEM, g, tolerance=-1.0), "tolerance: got -1.0; give a finite number above 0"),
        (lambda g: g.on(40, 4).amplitude("zz"), "unknown coordinate 'zz'. Allowed: v, w"),
        (lambda g: from_motion(SYSTEM, [np.nan, 0.0]), r"got \[nan, 0.0\] .* give 2 finite numbers, those of v, w"),
        (lambda g: from_motion(SYSTEM, {"v": 1.0}), "object of type dict .* give 2 finite numbers, those of v, w"),
        (lambda g: from_motion(SYSTEM, [1.0]), r"an array of shape \(1,\) .* give 2 finite numbers"),
        (lambda g: from_orbit(SYSTEM, None), "argument 'orbit': got None; give an Orbit"),
        (lambda g: follow(g, Rates(SYSTEM, "I"), (0.6, 0.9)), "I = 0.5, outside the interval"),
        (lambda g: follow(g, Rates(SYSTEM, "I"), (0.9, 0.3)), r"got \(0.9, 0.3\); give two finite numbers"),
        (lambda g: follow(g, Rates(SYSTEM, "I"), None), "got None; give two finite numbers"),
        (lambda g: follow(g, Rates(SYSTEM), (0.3, 0.9)), r"give Rates\(system, parameter\)"),
        (lambda g: follow(g, SYSTEM, (0.3, 0.9)), r"type System; give Rates\(system, parameter\)"),
        (lambda g: follow(None, Rates(SYSTEM, "I"), (0.3, 0.9)), "argument 'guess': got None; give a guess"),
        (lambda g: Rates(3), "got 3; give a System"),
    ],
)
def test_it_says_what_belongs_there(ask, words, guess):
    with pytest.raises(hb.ModelError, match=words):
        ask(guess)
