"""Trains against numbers computed independently; vehicle.json says how."""

import json
from pathlib import Path

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import cycle_after
from hbbogie.motion import group_states, moving_groups, simulate

KNOWN = json.loads((Path(__file__).parent / "vehicle.json").read_text(encoding="utf-8"))
TRAIN = hb.load_problem("train")


@pytest.mark.parametrize("n", [1, 2, 4])
def test_hopf_points_of_trains(n):
    found = hb.hopf_points(TRAIN.train(n), "V", (5.0, 130.0))  # several in one step
    for hopf, (V, omega) in zip(found, KNOWN["train_hopf"][str(n)], strict=True):
        assert hopf.value == pytest.approx(V, rel=1e-9)
        assert hopf.omega == pytest.approx(omega, rel=1e-9)


@pytest.mark.slow
def test_front_bogie_of_the_first_of_four_vehicles_hunts():
    """Shooting meets one with another integrator; the last wheelset moves half a micrometre."""
    known = KNOWN["train front"]
    system = TRAIN.train(4, V=known["V"])
    checked = hb.verify(system, cycle_after(system, {"y1_1": 0.01, "y2_1": 0.01}))
    assert checked.orbit.omega == pytest.approx(known["omega"], rel=1e-7)
    assert [checked.amplitudes[f"y{k}_{m}"] for m in (1, 2, 3, 4) for k in (1, 2, 3, 4)] == pytest.approx(
        known["amp"], rel=1e-7
    )
    ends = "front", "rear"
    outputs = {
        "acc_cg": [f"{end} frame acceleration" for end in ends],
        "acc_outer": [f"{end} frame acceleration, outer" for end in ends],
        "sumY": [f"guiding forces {k}" for k in (1, 2, 3, 4)],
    }
    for key, names in outputs.items():
        found = [checked.orbit.rms(f"{name}_{m}") for m in (1, 2, 3, 4) for name in names]
        assert found == pytest.approx(known[key], rel=1e-6)
    assert np.abs(checked.multipliers - complex(*known["multiplier"])).min() < 1e-5
    assert checked.orbit.largest_multiplier == pytest.approx(abs(complex(*known["multiplier"])), abs=1e-5)
    assert checked.orbit.stability.verdict == "stable"


def test_uncoupled_train_is_its_vehicles():
    """Without couplers the state matrix of a train has the eigenvalues of a vehicle, each n times."""
    free = TRAIN.train(3, kcy=0.0, ccy=0.0, kcp=0.0, ccp=0.0)
    one = hb.load_problem("vehicle").vehicle()
    many, own = (np.linalg.eigvals(s.ode_jacobian(np.zeros(s.n_states), s.vector()).full()) for s in (free, one))
    for value in own:
        assert np.sort(np.abs(many - value))[2] < 1e-6 * max(1.0, abs(value))


def test_outputs_of_a_train_are_those_of_its_vehicles():
    one, two = hb.load_problem("vehicle").vehicle().output_names, TRAIN.train(2).output_names
    assert two == tuple(f"{name}_{m}" for m in (1, 2) for name in one)


def test_couplers_are_symmetric():
    system = TRAIN.train(3, f11=0.0, f22=0.0)
    for function in system.dynamics.linear:
        matrix = function(system.vector()).full()
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-9 * np.abs(matrix).max())


def test_groups_of_a_train_are_its_bogies():
    assert list(TRAIN.train(2).groups) == [f"{end} bogie of vehicle {m}" for m in (1, 2) for end in ("front", "rear")]


@pytest.mark.parametrize("n", [0, 1.5, -1, 1000, float("nan"), "two"])
def test_number_of_vehicles(n):
    with pytest.raises(hb.ModelError, match="whole number from 1 to 64"):
        TRAIN.train(n)


def test_groups_that_move_as_in_one_cycle_are_on_it():
    """States in which each group follows its neighbour as in a cycle of all are states of that cycle."""
    system = TRAIN.train(2)
    hopf = hb.hopf_points(system, "V", (60.0, 110.0))[0].orbit
    waves = np.random.default_rng(5).uniform(0.5, 1.0, (2, system.n)) * [[1.0], [-1.0]]
    cycle = hopf.replace(coefficients=np.vstack([np.zeros(system.n), 0.01 * waves]))
    states = dict(group_states(system, [cycle]))
    assert len(states) == 4 + 3 + 3  # each alone, neighbours, all in three ways
    x = next(state for where, state in states.items() if "each after the one before" in where)
    t = np.linspace(0, cycle.period, 20001)
    assert np.abs(np.hstack([cycle.q(t), cycle.v(t)]) - x).max(axis=1).min() < 1e-3 * np.abs(x).max()


def test_fold_of_an_uncoupled_train_is_that_of_its_vehicle():
    """The sparse equations of the train have the fold of the full ones of the vehicle, and the same gradient."""
    one = hb.load_problem("vehicle").vehicle(V=60.0)
    cycle = cycle_after(one, {"y1": 0.01, "y2": 0.01, "y3": 0.01, "y4": 0.01})
    balance = hb.HarmonicBalance(9).equations(one)
    branch = hb.trace(balance, cycle, "V", (50.0, 60.0), stability=False)
    own = hb.fold(balance, min(branch.folds(), key=lambda special: special.value), search=False)
    free = TRAIN.train(2, kcy=0.0, ccy=0.0, kcp=0.0, ccp=0.0)
    guess = own.orbit.replace(
        system=free.name,
        coordinates=free.coordinate_names,
        units=tuple(c.unit for c in free.coordinates),
        coefficients=np.hstack([own.orbit.coefficients, 0.0 * own.orbit.coefficients]),
        omega=1.001 * own.omega,
        parameters=dict(free.values) | {"V": own.value + 0.01},
    )
    found = hb.fold(hb.HarmonicBalance(9).equations(free), guess, "V", search=False)
    assert found.value == pytest.approx(own.value, rel=1e-9)
    for name, slope in own.gradient.items():
        assert found.gradient[name] == pytest.approx(slope, rel=1e-6, abs=1e-12)


def test_shooting_on_a_long_train_takes_too_much_memory():
    system = TRAIN.train(16, V=65.0)
    hopf = hb.hopf_points(TRAIN.train(1), "V", (60.0, 110.0))[0].orbit
    wave = hopf.replace(
        system=system.name,
        coordinates=system.coordinate_names,
        units=tuple(c.unit for c in system.coordinates),
        coefficients=0.01 * np.vstack([np.zeros(system.n), np.ones((2, system.n))]),
        parameters=dict(system.values),
    )
    with pytest.raises(hb.ModelError, match=r"about \d+ GB of memory; the limit is 2 GB.*What to try"):
        hb.verify(system, wave)


def test_both_bogies_of_a_vehicle_in_a_train_hunt():
    """CVODES stays on the stable cycle, within the error of its frequency, of half as many harmonics."""
    system = TRAIN.train(2, V=65.0)
    cycle = cycle_after(system, {f"y{k}_1": 0.01 for k in (1, 2, 3, 4)})
    assert cycle.verdict == "stable"
    assert moving_groups(system, cycle) == "front bogie of vehicle 1 + rear bogie of vehicle 1"
    later = simulate(system, cycle, 60 * cycle.period, method="cvodes", step=cycle.period / 50)
    assert abs(2 * np.pi / later.period(periods=20) - cycle.omega) < cycle.errors["omega"] < 2e-4 * cycle.omega
