"""The main job: Table 1 of Yang (1995) beside multi-harmonic balance and integration."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import crossings

problem = hb.load_problem("yang1995")
STABLE = [s for s in problem.TABLE_1 if s.a1_ni is not None]


@pytest.fixture(scope="module")
def report(bogie):
    return problem.study(bogie, lambda message, fraction: None)


@pytest.fixture(scope="module")
def rows(report):
    """The rows of Table 1 by state, each by column."""
    columns = [column.partition(" [")[0] for column in report.tables[0].columns]
    return {row[0]: dict(zip(columns, row, strict=True)) for row in report.tables[0].rows}


def test_all_fourteen_states_are_shown(rows):
    assert list(rows) == list(range(1, 15))


@pytest.mark.parametrize("state", STABLE, ids=lambda s: f"state {s.state}")
def test_amplitudes_are_those_of_the_printed_integration(rows, state):
    """Within 1 % of the paper's integration; its frequencies are read off a 5 ms grid, good to 5 %."""
    row = rows[state.state]
    omega, a1, a2 = row["omega MHB"], row["a1 MHB"], row["a2 MHB"]
    assert a1 == pytest.approx(1e3 * state.a1_ni, rel=0.01)
    assert a2 == pytest.approx(1e3 * state.a2_ni, rel=0.01)
    assert omega == pytest.approx(state.omega_ni, rel=0.05)
    assert row["stability"] == "stable"


@pytest.mark.parametrize("state", STABLE, ids=lambda s: f"state {s.state}")
def test_harmonic_balance_agrees_with_our_integration(rows, state):
    """Two methods, one truth: 0.1 %."""
    row = rows[state.state]
    ours, integrated = ([row[f"{q} {m}"] for q in ("omega", "a1", "a2")] for m in ("MHB", "RK4"))
    np.testing.assert_allclose(ours, integrated, rtol=1e-3)


@pytest.mark.parametrize("state", problem.TABLE_1[1:], ids=lambda s: f"state {s.state}")
def test_harmonic_balance_agrees_with_the_closed_form(rows, state):
    """Two methods, one truth: 15 harmonics leave out 3e-4 at most, also on the unstable part of the branch."""
    row = rows[state.state]
    ours, exact = ([row[f"{q} {m}"] for q in ("omega", "a1", "a2")] for m in ("MHB", "exact"))
    np.testing.assert_allclose(ours, exact, rtol=3e-4)


def test_the_exact_fold_is_in_the_report(report):
    assert sum("88.76411319 m/s" in note for note in report.notes) == 1


def test_state_1_is_the_hopf_point(rows):
    assert rows[1]["omega MHB"] == pytest.approx(26.9485, abs=5e-4)
    assert rows[1]["a1 MHB"] is None


def test_state_2_is_unstable(rows):
    """Its printed equivalent linearisation: omega 27.01, a1 9.4 mm, a2 8.5 mm (small contact: close to linear)."""
    assert rows[2]["stability"] == "unstable"
    assert rows[2]["a1 MHB"] == pytest.approx(9.457, abs=2e-3)


def test_state_3_has_no_cycle(report):
    (note,) = (n for n in report.tables[0].notes if n.startswith("State 3:"))
    assert "no cycle at this speed" in note and "88.76" in note


def test_fifteen_harmonics_are_enough(report):
    """Against highest harmonic 61: frequency within 2e-5, amplitudes within 3e-4 at every stable state."""
    table = next(t for t in report.tables if t.name == "harmonics")
    errors = {row[0]: np.array(row[2:], dtype=float) / 100 for row in table.rows}
    assert errors[15][0] < 2e-5 and errors[15][1:].max() < 3e-4
    assert 0.03 < errors[1][1:].max() < 0.12
    assert 0.003 < errors[3][1:].max() < 0.013


@pytest.mark.parametrize(
    ("V", "omega", "a1", "a3"),
    [(127.81, 37.626573, 0.01531334, 0.01378380), (184.46, 43.487785, 0.02905325, 0.02446477)],
)
def test_61_harmonics_meet_exact_orbits(bogie, branch, V, omega, a1, a3):
    """PUBLISHED: periodic orbits with located contact times and matrix exponentials, closed to 1e-12."""
    equations = hb.HarmonicBalance(61).equations(bogie)
    guess = max(crossings(hb.HarmonicBalance(15).equations(bogie), branch, V), key=lambda o: o.amplitude("q1"))
    orbit = hb.solve(equations, guess, V=V)
    assert orbit.omega == pytest.approx(omega, rel=1e-6)
    assert orbit.amplitude("q1") == pytest.approx(a1, rel=1e-5)
    assert orbit.amplitude("q3") == pytest.approx(a3, rel=1e-5)


def test_gravity_stiffness_changes_the_critical_speed_upwards_or_downwards_but_not_much():
    """W lam / a = 9.3 kN/m beside 6 MN/m of primary stiffness: of the order of a thousandth."""
    with_gravity = hb.hopf_points(problem.bogie(gravity=True), "V", (50.0, 200.0))[0].value
    assert 0 < abs(with_gravity / 90.974 - 1) < 0.03


def test_the_fold_speed_does_not_depend_on_the_clearance(branch):
    """The flange force is homogeneous in (y, y0): every length scales with y0, the speed stays."""
    system = problem.bogie(y0=0.0182)
    hopf = hb.hopf_points(system, "V", (60.0, 190.0))[0]
    wide = hb.trace(hb.HarmonicBalance(15).equations(system), hopf, "V", (60.0, 120.0))
    assert wide.folds()[0].value == pytest.approx(branch.folds()[0].value, rel=1e-9)
    assert wide.folds()[0].orbit.amplitude("q1") == pytest.approx(2 * branch.folds()[0].orbit.amplitude("q1"), rel=1e-6)


def test_a_bogie_that_never_hunts_gets_a_note():
    """Without conicity there is nothing that drives the motion."""
    report = problem.study(problem.bogie(lam=0.0), lambda message, fraction: None)
    assert "No Hopf point" in report.notes[0]
