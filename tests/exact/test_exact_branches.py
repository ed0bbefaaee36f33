"""Branches of exact cycles, folds with gradients, and many designs at once."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.errors import ModelError
from hbbogie.exact import (
    at_grazing,
    critical_values,
    cycle_of,
    fold_of,
    follow,
    gradients,
    hopf_of,
    stabilities,
    switched_linear,
)
from hbbogie.model import DeadBand
from hbbogie.results import ConvergenceError

NAMES = ("Mw", "Mf", "K1", "K2", "K4", "K6", "D2", "lam", "f11")


def designs(bogie: hb.System, count: int, seed: int = 0, names=NAMES, spread: float = 0.2) -> np.ndarray:
    rng = np.random.default_rng(seed)
    p = np.tile(bogie.vector(), (count, 1))
    places = [bogie.parameter_names.index(name) for name in names]
    p[:, places] *= 1 + spread * rng.uniform(-1, 1, (count, len(places)))
    return p


def with_values(bogie: hb.System, p: np.ndarray) -> hb.System:
    return bogie.with_parameters(**dict(zip(bogie.parameter_names, map(float, p), strict=True)))


@pytest.fixture(scope="module")
def walk(bogie):
    (hopf,) = hb.hopf_points(bogie, "V", (60.0, 190.0))
    return follow(at_grazing(bogie, hopf), (60.0, 190.0))


def test_branch_of_the_bogie(bogie, walk):
    assert str(walk.end) == "the end of the interval, 190"
    start, rear = walk.marked("grazing")
    (fold,) = walk.marked("fold")
    assert start.value == pytest.approx(90.974, abs=5e-4) and start.omega == pytest.approx(26.9485, abs=5e-5)
    assert rear.value == pytest.approx(88.76994, abs=5e-6)
    assert fold.value == pytest.approx(88.7641131943, abs=5e-11)
    assert walk.points[-1].value == pytest.approx(190.0, rel=1e-14)
    assert max(np.abs(p.closing.linearise(p.y[None]).F).max() for p in walk.points) < 1e-11
    # the rear wheelset just touches the flange at its grazing, the front one goes beyond
    cycle = cycle_of(rear)
    assert cycle.amplitude("q3") == pytest.approx(0.0091, rel=1e-12) and cycle.amplitude("q1") > 0.0091


@pytest.mark.parametrize("lam", [0.05, 0.11, 0.15])
def test_longer_steps_lead_to_the_same_folds_and_contacts(bogie, lam):
    """A branch has its folds and grazings whatever the steps by which it is followed."""
    for hopf in hb.hopf_points(bogie.with_parameters(lam=lam), "V", (20.0, 175.0))[:2]:
        start = at_grazing(bogie.with_parameters(lam=lam), hopf)
        fine, coarse = (follow(start, (20.0, 175.0), coarse=c, step=s) for c, s in ((False, 0.05), (True, 0.1)))
        assert coarse.end == fine.end
        for kind in ("fold", "grazing", "end"):
            values = [q.value for q in fine.marked(kind)]
            assert [q.value for q in coarse.marked(kind)] == pytest.approx(values, rel=1e-10)


def test_stability_below_a_hopf_point_is_that_of_all_eigenvalues(bogie):
    """The branch of each design is stable at rest from the lower end up to its first Hopf point, and only there."""
    p, place, low = designs(bogie, 40, seed=3, spread=0.6), bogie.parameter_names.index("V"), 5.0
    p[:, place] = 90.0
    p[20:, bogie.parameter_names.index("D2")] *= -0.2  # unstable from the beginning
    found = hopf_of(switched_linear(bogie), p, place, np.zeros(len(switched_linear(bogie).surfaces)), low)
    located = np.flatnonzero(np.isfinite(found.value))
    assert len(located) > 20 and found.first.any() and not found.first[located].all()
    for d in located:
        below = low + (found.value[d] - low) * (np.arange(16) + 0.5) / 16
        q = np.tile(p[d], (16, 1))
        q[:, place] = below
        rest = np.zeros(bogie.n_states)
        stable = all((np.linalg.eigvals(bogie.state_matrix(rest, one)).real < 0).all() for one in q)
        assert bool(found.first[d]) == stable


def test_points_of_the_branch_are_cycles_of_shooting(bogie, walk):
    for point in walk.points[3::6]:
        cycle = cycle_of(point)
        orbit = hb.Orbit(
            bogie.name, bogie.coordinate_names, tuple(c.unit for c in bogie.coordinates), cycle.harmonics(31),
            cycle.omega, cycle.parameters,
        )  # fmt: skip
        truth = hb.verify(bogie, orbit)
        assert cycle.omega == pytest.approx(truth.orbit.omega, rel=1e-11)
        assert cycle.amplitude("q1") == pytest.approx(truth.amplitudes["q1"], rel=1e-10)
        (stability,) = stabilities(point.closing, point.y[None], point.at)
        assert stability.verdict == truth.orbit.stability.verdict
        assert np.abs(stability.multipliers[:3]) == pytest.approx(
            np.abs(truth.orbit.stability.multipliers[:3]), abs=1e-7
        )


def test_stability_changes_at_the_fold_only(walk):
    place = next(i for i, p in enumerate(walk.points) if p.kind == "fold")
    verdicts = [stabilities(p.closing, p.y[None], p.at)[0].verdict for p in walk.points]
    assert set(verdicts[1:place]) == {"unstable"} and set(verdicts[place + 1 :]) == {"stable"}
    # at the grazing of the Hopf point the cycles are linear, at the fold +1 is double: neither has a verdict
    assert verdicts[0] == verdicts[place] == "unknown"


def test_gradient_obeys_the_laws_of_similarity(bogie, walk):
    (fold,) = walk.marked("fold")
    found = fold_of(fold.closing, fold.y[None])
    slope = gradients(found)[0]
    elasticity = dict(zip(bogie.parameter_names, slope * bogie.vector() / fold.value, strict=True))
    masses = ("Mw", "Mf", "Iwy", "Ify", "Ifr")
    forces = (*masses, *(f"K{i}" for i in range(7)), "D1", "D2", "f11", "f22", "f23", "f33")
    assert sum(elasticity[n] for n in forces) == pytest.approx(0.0, abs=1e-12)  # forces in another unit
    assert 2 * sum(elasticity[n] for n in masses) + elasticity["D1"] + elasticity["D2"] == pytest.approx(
        -1.0, abs=1e-11
    )
    assert elasticity["y0"] == pytest.approx(0.0, abs=1e-12)  # the forces scale with the gap


def test_gradient_is_the_slope_of_the_fold(bogie):
    # along a line in the parameters: the error of the linear prediction falls with the square of the step
    p, direction = bogie.vector(), np.zeros(len(bogie.parameters))
    for name, share in zip(NAMES, (0.3, -0.5, 0.7, 0.2, -0.4, 0.6, -0.1, 0.5, -0.3), strict=True):
        i = bogie.parameter_names.index(name)
        direction[i] = share * p[i]
    steps = np.array([0.0, 1e-3, 2e-3, 4e-3])
    found = critical_values(bogie, p + steps[:, None] * direction, "V", (10.0, 250.0))
    for value, gradient in ((found.fold, found.fold_gradient), (found.hopf.value, found.hopf.gradient)):
        slope = np.delete(gradient[0], 0) @ np.delete(direction, 0)
        error = np.abs(value[1:] - value[0] - slope * steps[1:])
        assert error[1:] / error[:-1] == pytest.approx(4.0, rel=0.03)


def test_hopf_points_of_designs_are_those_of_the_search(bogie):
    p = designs(bogie, 6)
    found = critical_values(bogie, p, "V", (10.0, 250.0))
    for d in range(len(p)):
        hopf = hb.hopf_points(with_values(bogie, p[d]), "V", (10.0, 250.0))[0]
        assert found.hopf.value[d] == pytest.approx(hopf.value, rel=1e-10)
        assert found.hopf.omega[d] == pytest.approx(hopf.omega, rel=1e-9)
        assert found.hopf.first[d]


@pytest.mark.parametrize(
    "count, names, spread", [(20, NAMES, 0.2), pytest.param(300, NAMES, 0.2, marks=pytest.mark.slow)]
)
def test_folds_of_designs_are_those_of_their_branches(bogie, count, names, spread):
    p = designs(bogie, count, seed=5, names=names, spread=spread)
    found = critical_values(bogie, p, "V", (10.0, 250.0))
    assert not found.failed.any()
    for d in range(count):
        one = with_values(bogie, p[d])
        (hopf, *_) = hb.hopf_points(one, "V", (10.0, 250.0))
        folds = [q.value for q in follow(at_grazing(one, hopf), (10.0, 1.2 * hopf.value)).marked("fold")]
        folds = [value for value in folds if value < hopf.value]
        if np.isfinite(found.fold[d]):
            assert found.fold[d] == pytest.approx(min(folds), abs=1e-9)
        else:
            assert not folds and "rises" in found.status[d]


def test_a_design_without_a_fold_says_why(bogie):
    p = designs(bogie, 150, seed=5, names=bogie.parameter_names[1:])[[41, 44]]
    found = critical_values(bogie, p, "V", (10.0, 250.0))
    assert np.isnan(found.fold).all() and not found.failed.any()
    assert all(s.startswith("no fold: at its grazing the branch rises") for s in found.status)


def test_a_design_whose_hopf_point_is_far_from_the_nominal_one(bogie):
    # conicity a fifth of the nominal one: the equilibrium stays stable up to much higher speeds, or for ever
    p = np.tile(bogie.vector(), (2, 1))
    p[:, bogie.parameter_names.index("lam")] = 0.02, 1e-4
    found = critical_values(bogie, p, "V", (10.0, 250.0))
    hopf = hb.hopf_points(with_values(bogie, p[0]), "V", (10.0, 250.0))
    assert found.hopf.value[0] == pytest.approx(hopf[0].value, rel=1e-10)
    assert np.isnan(found.fold[1]) and np.isnan(found.hopf.value[1])
    assert found.status[1] == "no fold: there is no Hopf point from 10 to 250"


def test_a_branch_that_ends_where_its_contact_is_lost():
    # damping that falls with the parameter: the cycles of a soft stop exist on one side of the Hopf point only
    x, c, k = hb.Coordinate("x"), hb.Parameter("c", 0.0), hb.Parameter("k", 1.0)
    stop = hb.Element("stop", DeadBand(k, 1.0), x.dot)
    system = hb.System("damper behind a gap", [x], [c, k], [x.ddot - c * x.dot + x + stop], [stop])
    (hopf,) = hb.hopf_points(system, "c", (-0.5, 0.5))
    walk = follow(at_grazing(system, hopf), (-0.5, 0.5))
    assert str(walk.end) == "the end of the interval, 0.5"
    assert min(p.value for p in walk.points) > -1e-12 and not walk.marked("fold")
    back = walk.points[5]
    down = follow(type(back)(back.closing, back.y, -back.tangent, back.at), (-0.5, 0.5))
    assert str(down.end).startswith("the last contact is lost") and down.points[-1].value == pytest.approx(
        0.0, abs=1e-12
    )
    assert cycle_of(down.points[-1]).omega == pytest.approx(1.0, rel=1e-12)


def test_what_cannot_be_asked(bogie):
    with pytest.raises(ModelError, match="one row for each design"):
        critical_values(bogie, np.zeros((3, 2)), "V", (10.0, 250.0))
    with pytest.raises(ConvergenceError, match="no Hopf point"):
        critical_values(bogie, bogie.vector()[None], "V", (10.0, 20.0))
