"""Values of parameters from the command line and from files, what messages call options, and what else it tells."""

from __future__ import annotations

import json
import logging
import re
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie.commandline import app, in_options, in_own_units, quantities, values_in
from hbbogie.progress import silent

runner = CliRunner()


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def call(*args):
    return runner.invoke(app, [str(a) for a in args])


UNITS = hb.load_problem("yang1995").bogie().naming.units


def value_of(text, name):
    return in_own_units(quantities([text], "--set"), UNITS)[name]


@pytest.mark.parametrize(
    "text", ["V=324km/h", "V=324 km/h", "V = 324 km/h", "V=90", "V=90 m/s", "V=90000mm/s", "V=9e1"]
)
def test_a_speed_of_ninety_metres_per_second(text):
    assert value_of(text, "V") == pytest.approx(90.0, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("K2=10 MN/m", "K2", 10e6),
        ("K2=10MN/m", "K2", 10e6),
        ("K2=1.2e4kN/m", "K2", 12e6),
        ("K2=10 kN/mm", "K2", 10e6),
        ("Mw=1.022t", "Mw", 1022.0),
        ("lam=20 %", "lam", 0.2),
        ("y0=9.1mm", "y0", 9.1e-3),
        ("h1=-.5m", "h1", -0.5),
        ("K6=2.71MN m", "K6", 2.71e6),
    ],
)
def test_units_are_understood_with_and_without_a_blank(text, name, value):
    assert value_of(text, name) == pytest.approx(value, rel=1e-12)


FILES = {
    "values.toml": 'V = "324 km/h"\nK2 = 10e6\n',
    "values.json": '{"V": "324km/h", "K2": 10000000.0}',
    "values.csv": "name,value,unit\nV,324,km/h\n\nK2,10,MN/m\n",
    "bare.csv": "V, 90\nK2, 10e6\n",
}


@pytest.mark.parametrize("name", FILES)
def test_files_hold_values(name, tmp_path):
    (tmp_path / name).write_text(FILES[name], "utf-8")
    units = {"V": "m/s", "K2": "N/m"}
    found = in_own_units(values_in(tmp_path / name), units)
    assert found == {"V": pytest.approx(90.0), "K2": pytest.approx(1e7)}


def test_a_command_takes_a_file(tmp_path):
    (tmp_path / "mu.toml").write_text("mu = 0.5\n", "utf-8")
    result = call("cycles", "van_der_pol", "--values", "mu.toml", "--harmonics", 5, "--json", "-q")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["data"]["parameters"] == {"mu": 0.5}
    result = call("cycles", "van_der_pol", "--values", "mu.toml", "--set", "mu=0.6", "--harmonics", 5, "--json", "-q")
    assert json.loads(result.stdout)["data"]["parameters"] == {"mu": 0.6}  # what is set comes after


@pytest.mark.parametrize("command", ["run", "cycles", "branch", "simulate", "animate", "compare", "basin", "design"])
def test_all_commands_that_take_values_take_a_file(command):
    assert "--values" in call(command, "--help").stdout


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none.toml", None, "no such file"),
        ("values.txt", "V = 1", "ends in .toml, .json, .csv"),
        ("bad.toml", "V = = 3", "cannot be read"),
        ("twice.toml", "V = 1\nV = 2", "cannot be read"),
        ("table.toml", "[V]\nvalue = 3", "V: got an object of type dict"),
        ("bad.json", "{", "cannot be read"),
        ("list.json", "[1, 2]", "no object of names and values"),
        ("twice.json", '{"V": 1, "V": 2}', "'V' is given twice"),
        ("long.csv", "V,1,m/s,4", "is not name, value"),
        ("text.csv", "V,fast", "'fast' is not a number"),
        ("unit.toml", 'V = "3 furlong"', "'furlong'"),
        ("unknown.toml", 'W3 = "3 m"', "unknown parameter 'W3'"),
        ("plain.toml", "W3 = 3", "unknown parameter 'W3'"),
        ("bounds.toml", "V = -1.0", "allowed is"),
    ],
)
def test_files_that_hold_something_else(name, content, said, tmp_path):
    if content is not None:
        (tmp_path / name).write_text(content, "utf-8")
    result = call("cycles", "yang1995", "--values", name)
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.split())


@pytest.mark.parametrize("text", ["V=", "V", "=3", "V=fast", "V=3 4", "V=1e", "V=--3", "V=km/h"])
def test_texts_that_are_no_values(text):
    with pytest.raises(hb.ModelError):
        in_own_units(quantities([text], "--set"), {"V": "m/s"})


# --- messages, order, logging ---------------------------------------------------------------------


def test_messages_name_options():
    said = in_options("'a.db' exists; go on with resume=True (--resume), or accept_changes=True (--accept-changes).")
    assert said == "'a.db' exists; go on with --resume, or --accept-changes."
    assert in_options("400 points were computed; raise max_points to go on").endswith("--max-points of hbbogie branch")
    assert in_options("give a direction, along={'q1': 1} (--along q1=1).") == "give a direction, --along q1=1."


def test_a_branch_ends_at_as_many_points_as_are_asked_for():
    args = ["--harmonics", 3, "--no-stability", "--no-figures", "-q"]
    result = call("branch", "bautin", "--max-points", 6, *args)
    assert result.exit_code == 0, result.output
    assert "a larger --max-points of hbbogie branch" in " ".join(result.stdout.split())
    assert call("branch", "bautin", "--max-points", 1, *args).exit_code == 2


def test_the_help_lists_the_commands_in_the_order_of_the_readme():
    """Which is that of their use."""
    readme = (Path(__file__).parents[2] / "README.md").read_text("utf-8")
    named = re.findall(r"^\| `hbbogie (\w+)", readme, re.MULTILINE)
    assert get_command(app).list_commands(None) == named


def test_steps_are_logged(caplog):
    with caplog.at_level(logging.DEBUG, "hbbogie"):
        silent("a step", None)
        silent("another", 0.5)
    assert [r.getMessage() for r in caplog.records] == ["a step", "another (50 %)"]
    result = call("cycles", "van_der_pol", "--harmonics", 3, "-v", "--json")
    assert result.exit_code == 0 and "hbbogie looking for cycles" in result.stderr
    json.loads(result.stdout)
    assert "leave one out" in str(call("cycles", "van_der_pol", "-v", "-q").exception)


def test_where_a_family_begins_methods_are_compared_on_the_branch_through_a_cycle():
    """The describing function of first order gives omega = 1 and a peak of 2 for every mu."""
    system = hb.load_problem("van_der_pol").van_der_pol()
    found = hb.compare(system, ["df1"], [0.5, 1.0], parameter="mu", interval=(-0.5, 3.0), truth="mhb15")
    assert [row.value for row in found.rows] == [0.5, 1.0]
    for row in found.rows:
        assert (row.orbits["df1"].omega, row.orbits["df1"].amplitude("x")) == pytest.approx((1.0, 2.0), rel=1e-9)
    assert found.rows[1].truth.period == pytest.approx(6.66328685932313, rel=1e-5)
    with pytest.raises(hb.ModelError, match="value of mu at which cycles exist"):
        hb.compare(system.with_parameters(mu=0.0), ["df1"], parameter="mu", interval=(-0.5, 3.0), truth="mhb3")


def test_the_mass_of_the_template_never_overtakes_its_belt(tmp_path):
    """The amplitude of its speed is known to first order: U^2 = 4 (v_h^2 - v^2) with the Hopf point v_h^2 = 0.625."""
    assert call("new", "my_bogie.py").exit_code == 0
    module = hb.load_problem(str(tmp_path / "my_bogie.py"))
    system = module.SYSTEM()
    (point,) = hb.hopf_points(system, "v", module.RANGE)
    assert point.value == pytest.approx(np.sqrt(0.625), rel=1e-9)
    v = module.RANGE[0]
    cycle = hb.find_cycles(system, v=v, stability=False, harmonics=7)[0]
    sliding = cycle.output("sliding speed")
    assert sliding.half_peak_to_peak == pytest.approx(np.sqrt(4 * (0.625 - v**2)), rel=1e-2)
    assert sliding.smallest > 0
