"""What results say of themselves: in a few lines, as tables, in notebooks, in files."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import Diagram
from hbbogie.brief import brief, columns, lines
from hbbogie.results import (
    Basin,
    Branch,
    Chart,
    ChartPoint,
    CriticalCurve,
    Criticals,
    Cycles,
    Ending,
    Hysteresis,
    Passage,
)

LONGEST = 1200


@pytest.fixture(scope="module")
def van_der_pol():
    return hb.load_problem("van_der_pol").van_der_pol()


@pytest.fixture(scope="module")
def cycle(bogie, branch):
    at = branch[40]
    return at.replace(stability=hb.floquet(bogie, at), errors={"omega": 1e-6, "waveform": 2e-4, "q1": 1e-6})


def made_up_results(bogie, branch, cycle):
    """One result of each kind, with much in each list."""
    values, text = np.linspace(88.0, 91.0, 500), "a sentence that says why it was left undecided, at some length"
    ends = (Ending("interval", "the end was reached"), Ending())
    curve = CriticalCurve(
        kind="fold",
        values=values,
        over_values=values / 1800,
        omega=values,
        slope=values,
        character=("minimum",) * 500,
        side=np.ones(500, int),
        residual=np.zeros(500),
        ends=ends,
    )
    point = ChartPoint(kind="cusp", curve="fold", value=90.0, over_value=0.05, omega=27.0, status=text)
    labels = ("speed V [m/s]", "conicity lam [1]")
    chart = Chart(
        system="bogie",
        parameter="V",
        over="lam",
        labels=labels,
        span=(60.0, 190.0),
        interval=(0.02, 0.3),
        folds=(curve,) * 40,
        hopf=(),
        special=(point,) * 90,
        without_fold=((0.1, 0.2),) * 30,
        without_hopf=(),
        notes=(text,) * 50,
    )
    grid = np.ones((500, 40))
    basin = Basin(
        system="bogie",
        parameter="V",
        parameter_unit="m/s",
        values=values,
        coordinate="q1",
        unit="m",
        factors=np.linspace(0, 2, 40),
        amplitudes=np.linspace(0.001, 0.02, 40) * grid,
        direction="the shape of the unstable cycle",
        outcome=np.full((500, 40), "rest"),
        time=grid,
        reached=grid,
        reason=np.full((500, 40), text),
        unstable=values,
        stable=values,
        parameters=dict(bogie.values),
        notes=(text,) * 100,
    )
    passage = Passage(rate=-0.1, values=values, peaks=values, event=88.2, predicted=float("nan"), status=text)
    hysteresis = Hysteresis(
        system="bogie",
        parameter="V",
        parameter_unit="m/s",
        interval=(85.0, 95.0),
        coordinate="q1",
        unit="m",
        level=0.001,
        meaning="a tenth of the gap",
        falling=(passage,) * 6,
        rising=(passage,) * 6,
        fold=88.7,
        hopf=90.9,
        parameters=dict(bogie.values),
    )
    long = branch.with_orbits(branch.orbits * 40)
    motion = hb.simulate(bogie, {"q1": 0.01}, 0.5)
    return {
        "orbit": cycle,
        "equilibrium": cycle.replace(coefficients=cycle.coefficients[:1], omega=0.0, stability=None, errors=None),
        "stability": cycle.stability,
        "branch": replace(long, special=branch.special * 100),
        "special point": branch.special[0],
        "curve": curve,
        "chart": chart,
        "chart point": point,
        "basin": basin,
        "passage": passage,
        "hysteresis": hysteresis,
        "motion": motion,
        "system": bogie,
        "dynamics": bogie.dynamics,
        "parameter": bogie.parameters[0],
        "coordinate": hb.Coordinate("x", "m", "very long " * 900),
        "problem": hb.load_problem("yang1995"),
        "equations": hb.HarmonicBalance(15).equations(bogie),
        "cycles": Cycles([cycle] * 300, [text] * 300),
        "no cycles": Cycles([], [text] * 300),
        "critical value": (critical := hb.fold(hb.HarmonicBalance(15).equations(bogie), branch.folds()[0], "V")),
        "critical values": Criticals([critical] * 300, [text] * 300, [text] * 20),
        "naming": bogie.naming,
        "diagram": Diagram("V", (60.0, 190.0), [], {f"branch_{i}": long for i in range(9)}, {}, [], (text,) * 90),
    }


@pytest.fixture(scope="module")
def shown(bogie, branch, cycle):
    return made_up_results(bogie, branch, cycle)


def test_no_representation_fills_the_screen(shown):
    for name, value in shown.items():
        text = repr(value)
        assert len(text) < LONGEST and 1 <= text.count("\n") + 1 <= 10, f"{name}: {text}"
        assert "array(" not in text and "SX" not in text, f"{name}: {text}"


def test_results_say_what_where_and_how_sure(shown, branch, cycle):
    said = {name: repr(value) for name, value in shown.items()}
    assert f"{cycle.period:.7g} s" in said["orbit"] and cycle.stability.verdict in said["orbit"]
    assert "V = " in said["orbit"] and "m/s" in said["orbit"] and "0.0002" in said["orbit"]
    assert cycle.stability.reason[:60] in said["stability"]
    fold = branch.folds()[0]
    assert f"fold at V = {fold.value:.8g} m/s, minimum" in repr(fold)
    assert "Hopf point at V = 90.97" in said["branch"] and "400 special points" in said["branch"]
    assert said["parameter"] == "Parameter V = 90 m/s: speed (1 to 400)"
    assert "bogie(...)" in said["problem"] and "V from 60 to 190" in said["problem"]
    assert "300 cycles" in said["cycles"] and "294 more" in said["cycles"]
    assert "phase set by q1" in said["equations"]


def test_a_search_that_was_cut_short_says_so():
    for found in (Cycles([], ["seen"], ["the time was over"]), Criticals([], ["seen"], ["the time was over"])):
        assert not found.complete and "not complete: the time was over" in repr(found)


def test_notebooks_get_a_table_and_a_thumbnail(shown):
    for name, value in shown.items():
        if not hasattr(value, "_repr_html_") or name in ("parameter", "coordinate"):
            continue
        page = value._repr_html_()
        assert page.startswith("<div>") and page.endswith("</div>")
        drawn = name in ("orbit", "branch", "motion", "chart", "basin", "hysteresis", "cycles")
        assert ("data:image/png;base64," in page) == drawn, name
    assert "<td>front wheelset, lateral q1</td>" in shown["orbit"]._repr_html_()
    assert "<td>flange clearance</td>" in shown["system"]._repr_html_()


def test_a_list_of_cycles_prints_as_a_table_that_fits_a_terminal(van_der_pol):
    found = hb.find_cycles(van_der_pol, mu=1.0)
    head, titles, row, *_ = repr(found).splitlines()
    assert head == "1 cycle of van der Pol's oscillator at mu = 1" or head.startswith("1 cycle of ")
    assert titles.split()[:2] == ["period", "[s]"] and "6.663287" in row and "stable" in row
    assert max(map(len, repr(found).splitlines())) <= 80 and str(found) == repr(found)
    assert copy.copy(found).evidence == found.evidence


def test_results_draw_themselves(shown, branch, cycle):
    from matplotlib import pyplot as plt

    for value in (branch, cycle, shown["motion"], shown["chart"], shown["basin"]):
        assert value.plot().lines or value.plot().collections
    assert branch.plot("q3").get_ylabel().startswith("peak")
    plt.close("all")


def test_a_branch_is_a_sequence_of_its_points(branch):
    assert list(branch) == list(branch.orbits) and branch[-1] is branch.orbits[-1] and len(branch[2:5]) == 3
    fold = branch.place(branch.folds()[0])
    assert branch[fold - 2 : fold + 3].folds() == branch.folds() and not branch[: fold - 2].folds()
    assert branch[:].ends == branch.ends and branch[1:].ends[0].kind == "shown"


def test_a_stretch_of_the_parameter_has_the_parts_of_both_sheets(branch):
    parts = branch.between(89.0, 90.0)
    assert len(parts) == 2 and {v for part in parts for v in part.verdicts} == {"stable", "unstable"}
    inside = np.sum((branch.values >= 89.0) & (branch.values <= 90.0))
    assert sum(map(len, parts)) == inside and branch.between(0.0, 1.0) == ()
    (whole,) = branch.between(0.0, 1000.0)
    assert whole.orbits == branch.orbits and whole.special == branch.special


def test_a_table_of_a_branch_carries_units(branch):
    table = branch.to_dataframe()
    assert table.index.name == "V" and len(table) == len(branch)
    np.testing.assert_array_equal(table["peak q1"], branch.amplitude("q1"))
    np.testing.assert_array_equal(table.index, branch.values)
    numbers = [name for name in table.columns if name not in ("stability", "method")]
    assert set(table.attrs["units"]) == {"V", *numbers} and table.attrs["units"]["V"] == "m/s"
    assert set(table["stability"]) <= {"stable", "unstable", "unknown"}


def test_a_saved_branch_keeps_names_units_and_descriptions(branch, tmp_path):
    branch.save(tmp_path / "branch.nc")
    saved = Branch.load(tmp_path / "branch.nc")
    assert saved.label == branch.label == "speed V [m/s]" and saved[3].naming == branch[3].naming
    assert saved.special[0].orbit.naming.plain("q1") == "front wheelset, lateral q1"
    assert saved.plot().get_xlabel() == "speed V [m/s]"
    data = branch.to_dataset()
    np.testing.assert_array_equal(data["V"].values, branch.values)
    for name, variable in data.variables.items():
        if variable.dtype.kind in "fi" and not name.endswith(("_real", "_imaginary", "onward_of")):
            assert variable.attrs.get("units"), name


def test_the_parameter_takes_another_name_where_its_own_is_taken():
    x, omega = hb.Coordinate("x", "m"), hb.Parameter("omega", 1.0, "rad/s")
    system = hb.System("s", [x], [omega], [x.ddot - (1 - x**2) * x.dot + omega**2 * x])
    (orbit,) = hb.find_cycles(system, stability=False)
    data = Branch((orbit,), "omega").to_dataset()
    assert float(data["omega_value"][0]) == 1.0 and float(data["omega"][0]) == orbit.omega


def test_files_without_names_are_read(branch, tmp_path):
    """Files of version 0.1 hold the units of the coordinates in an attribute, and no descriptions."""
    data = branch.to_dataset().drop_vars(
        [f"{k}_{w}" for k in ("coordinate", "parameter") for w in ("unit", "description")]
    )
    data.attrs["units"] = '["m", "rad", "m", "rad", "m", "rad", "rad"]'
    old = Branch.from_dataset(data)
    assert old[0].units == branch[0].units and old.label == "V" and repr(old).startswith("Branch of")


def test_a_problem_pickles_by_its_file():
    problem = hb.load_problem("yang1995")
    assert pickle.loads(pickle.dumps(problem)) is problem


def test_lines_and_columns_are_cut_and_aligned():
    text = lines("head", *["word " * 500] * 30)
    assert len(text) < LONGEST and text.endswith("more") and text.count("\n") == 7
    assert columns([["a", "bb"], ["ccc", "d"]]) == ["  a  bb", "ccc   d"]
    assert brief(hb.HarmonicBalance(15)).startswith("HarmonicBalance\n  ")
