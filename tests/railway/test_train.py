"""Trains against numbers computed independently; vehicle.json says how."""

import json
from pathlib import Path

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import cycle_after

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
