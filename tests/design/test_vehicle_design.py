"""Design of the vehicle: folds of all attractors are followed from design to design, and none of them is lost."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import cycle_after
from hbbogie.critical import fold, hopf_gradient
from hbbogie.design import DesignPoint, Expression, Limit, design_point, optimise
from hbbogie.motion import moving_groups

H, RANGE = 5, (30.0, 110.0)
CHANGED = {"kpx": 24e6, "kpy": 2.72e6, "c1": 260e3, "Fb": 4.2e3, "c2": 7e3}  # N/m, N/m, N s/m, N, N s/m


def lowest_of(system: hb.System, start: hb.Orbit) -> DesignPoint:
    """Return the design with its Hopf points and the lowest fold of the branch through a start."""
    equations = hb.HarmonicBalance(H).equations(system)
    branch = hb.trace(equations, start, "V", (50.0, 90.0), families=False, stability=False)
    lowest = min(branch.folds(), key=lambda special: special.value)
    hopf = [hopf_gradient(system, h) for h in hb.hopf_points(system, "V", RANGE)]
    names = ("fold 1", "Hopf point 1", "Hopf point 2")
    return DesignPoint(system, equations, "V", RANGE, (fold(equations, lowest), *hopf), names)


@pytest.fixture(scope="module")
def before():
    vehicle = hb.load_problem("vehicle").vehicle()
    return lowest_of(vehicle, hb.hopf_points(vehicle, "V", (82.0, 90.0))[0])


def test_a_fold_moves_as_its_gradient_says(before):
    """Central differences of folds solved for at other designs."""
    there = before.critical[0]
    assert moving_groups(before.system, there.orbit) == "both"
    for name in ("kpx", "Fb"):
        p, h = before.system.values[name], 1e-3
        ends = [
            next(c for c in point.critical if c.kind == "fold").value
            for point in (
                design_point(before.system.with_parameters(**{name: p * (1 + s * h)}), "V", RANGE, H, before)
                for s in (-1, 1)
            )
        ]
        assert (ends[1] - ends[0]) / (2 * h) == pytest.approx(p * there.gradient[name], rel=1e-3, abs=1e-4)


def test_a_fold_is_followed_to_a_design_far_away(before):
    """It is the fold of the branch there, on the way to which Newton's method fails in one step."""
    system = before.system.with_parameters(**CHANGED)
    c = design_point(system, "V", RANGE, H, before).critical[0]
    motion = cycle_after(system.with_parameters(V=62.0), dict.fromkeys(("y1", "y2", "y3", "y4"), 0.01))
    assert moving_groups(system, motion) == "both"
    cycle = hb.solve(hb.HarmonicBalance(H).equations(system), motion, method="newton", V=62.0)
    assert c.value == pytest.approx(lowest_of(system, cycle).critical[0].value, rel=1e-8)


def test_limits_of_the_problem_are_those_of_a_wheelset_that_steers():
    """In the sharpest curve the springs' moment is that of creep forces at their limit."""
    module = hb.load_problem("vehicle_design")
    p = module.SYSTEM().values
    R = module.slip_radius(p)
    assert 2 * p["kpx"] * p["bp"] ** 2 * p["lb"] / R == pytest.approx(2 * p["a"] * p["muN"], rel=1e-14)
    w, wheelbase, axle_load = p["by"] * np.pi / 180, 2 * p["lb"], 2 * p["Q"]
    assert p["c1"] * w < p["Fb"]  # below blow-off
    moment = 2 * p["ksx"] * p["bs"] ** 2 * p["lc"] / 250 + 2 * p["by"] * p["c1"] * w
    assert float(module.rotation_resistance(p)) == pytest.approx(moment / (wheelbase * axle_load), rel=1e-14)


def test_optimum_of_one_bogie():
    """Gradient of the raised value = multiplier times that of the limit, in what is free; both limits are met."""
    module = hb.load_problem("vehicle_design")
    bogie = hb.load_problem("vehicle").vehicle(bogies=1)
    p = bogie.values
    steer = Limit(Expression("radius without slip", module.slip_radius, "m"), lower=3000.0)
    over = {"kpx": (0.8 * p["kpx"], 1.2 * p["kpx"]), "kpy": (0.9 * p["kpy"], 1.1 * p["kpy"])}
    found = optimise(bogie, over=over, subject_to=[steer], interval=(40.0, 110.0), harmonics=3)
    assert found.converged and found.feasible and found.value > found.value_before
    by_name = {a.name: a for a in found.active}
    assert set(by_name) == {"radius without slip", "kpy"}
    slope = found.after.critical[0].gradient
    per_metre = p["a"] * p["muN"] / (p["bp"] ** 2 * p["lb"])  # kpx for a metre of radius
    assert by_name["radius without slip"].multiplier == pytest.approx(-slope["kpx"] * per_metre, rel=1e-6)
    assert by_name["kpy"].multiplier == pytest.approx(-slope["kpy"], rel=1e-6)
    assert found.parameters["kpx"] == pytest.approx(3000 * per_metre, rel=1e-9)
