"""The explorer without a browser: views, diagrams that follow them, cycles, scripts and reports, the server."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest

from hbbogie import ModelError, hopf_points, load_problem, solve, trace
from hbbogie.critical import critical_speeds_of
from hbbogie.exact import Exact
from hbbogie.explorer import Mistakes, Session, View, application, explored, opening, view_of
from hbbogie.model import shipped_problems, system_of


def _session(name, **values):
    module = load_problem(name)
    system = system_of(module, **values)
    return Session(name, module, system, opening(module, system))


@pytest.fixture(scope="module")
def bogie():
    return _session("yang1995")


@pytest.fixture(scope="module")
def found(bogie):
    return explored(bogie.system, bogie.first)


def _moved(view, **values):
    return View(view.parameter, view.interval, view.coordinate, {**view.values, **values})


# --- views -------------------------------------------------------------------------------------


def test_a_view_reads_what_it_wrote(bogie):
    assert view_of(bogie.system, json.loads(json.dumps(bogie.first.as_dict()))) == bogie.first


def test_a_view_takes_numbers_with_units(bogie):
    given = bogie.first.as_dict() | {"low": "216 km/h", "values": {"K1": "3 MN/m", "lam": " 0.1 "}}
    view = view_of(bogie.system, given)
    assert view.interval[0] == pytest.approx(60.0, rel=1e-12)
    assert view.values["K1"] == 3e6 and view.values["lam"] == 0.1


def test_each_wrong_field_has_its_sentence(bogie):
    values = {"K1": "soft", "Mw": -1, "K2": "3 kg", "K3": None}
    given = bogie.first.as_dict() | {"low": "x", "coordinate": "q9", "values": values}
    with pytest.raises(Mistakes) as caught:
        view_of(bogie.system, given)
    said = caught.value.fields
    assert set(said) == {"K1", "Mw", "K2", "K3", "low", "coordinate"}
    assert "not a number" in said["K1"] and "allowed" in said["Mw"] and "'N/m'" in said["K2"]


@pytest.mark.parametrize("given", [None, [], {}, {"parameter": 3}, {"parameter": "V", "low": 1, "high": True}])
def test_what_is_no_view_is_refused_in_sentences(bogie, given):
    with pytest.raises(Mistakes):
        view_of(bogie.system, given)


def test_an_empty_interval_is_refused(bogie):
    with pytest.raises(Mistakes, match="low < high"):
        view_of(bogie.system, bogie.first.as_dict() | {"low": 200})


# --- diagrams ----------------------------------------------------------------------------------


def test_the_fold_is_that_of_the_design(bogie, found):
    """Followed from a diagram at other values; the batch method begins from nothing."""
    after = explored(bogie.system, _moved(bogie.first, K2=1.2e7, lam=0.06), found)
    truth = critical_speeds_of(bogie.system, {"K2": [1.2e7], "lam": [0.06]}, interval=(10.0, 250.0))
    (fold,) = (s.value for b in after.diagram.branches.values() for s in b.folds())
    assert fold == pytest.approx(truth.fold[0], rel=1e-9)
    assert not after.anew and after.complete
    assert {"stable", "unstable"} <= {v for b in after.diagram.branches.values() for v in b.verdicts}


def test_branches_without_a_hopf_point_in_sight_are_found(bogie):
    """At 100 m/s the equilibrium is unstable already, and the cycle exists."""
    view = View("V", (95.0, 150.0), "q1", {**bogie.first.values, "V": 100.0})
    first = explored(bogie.system, view)
    assert not first.diagram.hopf and len(first.diagram.branches) == 1
    after = explored(bogie.system, _moved(view, K2=1.05e7), first)
    (branch,) = after.diagram.branches.values()
    there = bogie.system.with_parameters(K2=1.05e7)
    (hopf,) = hopf_points(there, "V", (60.0, 190.0))
    whole = trace(Exact().equations(there), hopf, "V", (60.0, 150.0))
    assert branch.amplitude("q1").max() == pytest.approx(whole.amplitude("q1").max(), rel=1e-9)
    assert not after.anew


def test_harmonic_balance_follows_to_the_known_fold():
    """Bautin's normal form has its fold at -a^2 / 4, and multiplier and radii in closed form."""
    session = _session("bautin")
    first = explored(session.system, session.first)
    after = explored(session.system, _moved(session.first, a=0.8), first)
    (fold,) = (s.value for b in after.diagram.branches.values() for s in b.folds())
    assert fold == pytest.approx(-0.16, abs=1e-9) and not after.anew


def test_a_detached_branch_is_followed():
    """The isola around mu = 0 begins at no Hopf point."""
    session = _session("isola")
    first = explored(session.system, session.first)
    after = explored(session.system, _moved(session.first, rho=0.4), first)
    assert [len(one.diagram.branches) for one in (first, after)] == [2, 2] and not after.anew
    (ring,) = (b for b in after.diagram.branches.values() if b.folds())
    assert sorted(s.value for s in ring.folds()) == pytest.approx([-0.4, 0.4], abs=1e-9)


LARGE = ("train", "vehicle", "vehicle_design")  # smooth, and of more than 20 states


@pytest.mark.parametrize("name", LARGE)
def test_large_systems_are_refused_in_a_sentence(name):
    with pytest.raises(ModelError, match="states and no cycles in closed form"):
        _session(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in shipped_problems() if n not in (*LARGE, "kaas_petersen1986")])  # a minute
def test_every_problem_can_be_explored(name):
    session = _session(name)
    start = json.loads(json.dumps(session.opening(), allow_nan=False))
    drawn = json.loads(json.dumps(session.diagram({"view": start["view"]}), allow_nan=False))
    assert drawn["branches"] and drawn["rest"]
    branch = drawn["branches"][0]
    x, y = branch["curves"][0]["points"][-1]
    cycle = session.cycle({"view": start["view"], "branch": branch["name"], "x": x, "y": y})
    assert len(cycle["t"]) == len(cycle["waves"][0]["q"]) and cycle["verdict"] in ("stable", "unstable", "unknown")
    other = [p for p in start["parameters"] if p["name"] != start["view"]["parameter"]]
    if other:
        values = {other[0]["name"]: other[0]["value"] * 1.02 + 1e-3}
        assert session.diagram({"view": {**start["view"], "values": values}})["branches"]


# --- what the page draws -----------------------------------------------------------------------


def test_curves_of_a_branch_meet_at_the_fold(bogie):
    drawn = bogie.diagram({"view": bogie.first.as_dict()})
    curves = drawn["branches"][0]["curves"]
    assert [c["verdict"] for c in curves] == ["unstable", "stable"]
    assert curves[0]["points"][-1] == curves[1]["points"][0]
    (fold,) = (m for m in drawn["marks"] if m["kind"] == "fold")
    assert min(p[0] for c in curves for p in c["points"]) == pytest.approx(fold["x"], abs=1e-3)
    ends = [(r["verdict"], r["points"][0][0], r["points"][-1][0]) for r in drawn["rest"]]
    (hopf,) = (m for m in drawn["marks"] if m["kind"] == "hopf")
    assert ends == [("stable", 60.0, pytest.approx(hopf["x"], abs=1e-3)), ("unstable", ends[0][2], 190.0)]
    assert drawn["height"]["unit"] == "mm" and "[mm]" in drawn["height"]["label"]
    assert drawn["said"][0].startswith("Between V = 88.76 and 90.97 m/s a large disturbance starts oscillation")


def test_a_click_gives_the_cycle_at_that_place(bogie, found):
    (branch,) = found.diagram.branches.values()
    near = solve(Exact().equations(bogie.system), branch.orbits[-1], V=150.0)
    place = {"branch": "branch", "x": 150.0, "y": 1e3 * near.amplitude("q1")}
    cycle = bogie.cycle({"view": bogie.first.as_dict(), **place})
    assert cycle["x"] == pytest.approx(150.0, rel=1e-12) and cycle["verdict"] == "stable"
    assert cycle["y"] == pytest.approx(place["y"], rel=1e-9)
    wave = cycle["waves"][0]
    assert max(np.abs(wave["q"])) == pytest.approx(place["y"], rel=1e-3) and wave["unit"] == "mm"
    assert len(cycle["multipliers"]) == bogie.system.n_states
    assert cycle["frames"]["shapes"][0][0]["kind"] == "ground"


def test_an_output_is_drawn_over_the_parameter(bogie):
    """The flange force is the stiffness times what the wheelset goes beyond the clearance; none at the grazing."""
    view = bogie.first.as_dict() | {"coordinate": "front flange force"}
    assert "front flange force" in [c["name"] for c in bogie.opening()["coordinates"]]
    drawn = bogie.diagram({"view": view})
    assert drawn["height"]["unit"] == "kN"
    (hopf,) = (m for m in drawn["marks"] if m["kind"] == "hopf")
    assert hopf["y"] == 0.0
    x, y, _ = drawn["branches"][0]["points"][-1]
    cycle = bogie.cycle({"view": view, "branch": drawn["branches"][0]["name"], "x": x, "y": y})
    peaks = {w["name"]: max(np.abs(w["q"])) for w in cycle["waves"]}
    stiffness, gap = (bogie.system.values[n] for n in ("K0", "y0"))
    assert y == pytest.approx(stiffness * (peaks["q1"] - 1e3 * gap) * 1e-6, rel=1e-3)
    assert peaks["front flange force"] == pytest.approx(y, rel=1e-3)


def test_wrong_questions_are_answered_by_sentences(bogie):
    view = bogie.first.as_dict()
    with pytest.raises(ModelError, match="click on a curve"):
        bogie.cycle({"view": view, "branch": "twig", "x": 100, "y": 10})
    with pytest.raises(ModelError, match="Which cycle"):
        bogie.cycle({"view": view})


# --- exports -----------------------------------------------------------------------------------


def test_the_script_computes_what_is_shown(bogie, tmp_path, monkeypatch, capsys):
    view = bogie.first.as_dict()
    moved = {**view, "values": {"K2": 1.2e7}}
    monkeypatch.chdir(tmp_path)
    exec(bogie.script({"view": moved, "pinned": view})["text"], {})
    drawn = bogie.diagram({"view": moved})
    (fold,) = (m["x"] for m in drawn["marks"] if m["kind"] == "fold")
    assert f"fold at V = {fold:.6g}"[:-1] in capsys.readouterr().out
    assert (tmp_path / "diagram.png").stat().st_size > 10_000


def test_the_report_of_a_session_stands_alone(bogie):
    view = bogie.first.as_dict()
    text = bogie.report({"view": {**view, "values": {"K2": 1.2e7}}, "pinned": view})["text"]
    assert "Changed from the problem&#39;s own values: K2" in text and "Beside the pinned" in text
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)


# --- the server --------------------------------------------------------------------------------


def _ask(address, path, question, **headers):
    request = urllib.request.Request(f"{address}{path}", json.dumps(question).encode(), headers)
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def _refused(address, path, question, **headers):
    try:
        return 200, _ask(address, path, question, **headers)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


@pytest.fixture(scope="module")
def served():
    command = [sys.executable, "-m", "hbbogie", "explore", "bautin", "--no-browser", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    first = process.stdout.readline()
    yield process, re.search(r"http://127\.0\.0\.1:\d+/", first)[0]
    if process.poll() is None:
        process.kill()
    process.communicate()


def test_the_server_answers_and_refuses(served):
    _, address = served
    start = _ask(address, "api/opening", {})
    assert start["system"] == "Bautin normal form" and "harmonic balance" in start["said"]
    code, said = _refused(address, "api/diagram", {"view": {**start["view"], "values": {"a": "much"}}})
    assert code == 422 and "not a number" in json.loads(said)["fields"]["a"]
    code, _ = _refused(address, "api/opening", {}, Host="example.org")  # a name of another machine that leads here
    assert code == 400
    with urllib.request.urlopen(address) as page:
        assert "default-src 'self'" in page.headers["Content-Security-Policy"]
        text = page.read().decode()
    assert not re.findall(r"(?:src|href)=\"(?:https?:)?//", text)


def test_a_port_that_is_taken_says_so(served):
    _, address = served
    port = address.rstrip("/").rpartition(":")[2]
    command = [sys.executable, "-m", "hbbogie", "explore", "bautin", "--no-browser", "--port", port]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 2 and f"port {port} cannot be used" in run.stderr and "--port 0" in run.stderr


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_ends_it(served):
    process, _ = served
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=10)
    assert process.returncode == 0 and "Ended." in out and "Traceback" not in error


def test_the_missing_extra_says_so(bogie, monkeypatch):
    monkeypatch.setitem(sys.modules, "starlette.applications", None)
    with pytest.raises(ModelError, match=r"hbbogie\[explore\]"):
        application(bogie)
