import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from typer.testing import CliRunner

import hbbogie
from hbbogie import Branch
from hbbogie.commandline import app

matplotlib.use("Agg")
PNG = b"\x89PNG\r\n\x1a\n"
runner = CliRunner()


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # commands write to ./out where nothing else is said


def call(*args):
    return runner.invoke(app, [str(a) for a in args])


def process(*args, **options):
    environment = os.environ | {"PYTHONPATH": str(Path(hbbogie.__file__).parent.parent), "PYTHONWARNINGS": ""}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": environment}
    return subprocess.Popen([sys.executable, "-m", "hbbogie", *args], **pipes, **options)


def document(result):
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_version():
    result = call("--version")
    assert result.exit_code == 0 and result.stdout == f"hbbogie {hbbogie.__version__}\n"


def test_start_up_imports_neither_matplotlib_nor_xarray():
    code = "import sys, hbbogie.commandline.main; print({'matplotlib', 'xarray'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "set()\n"


@pytest.mark.parametrize("command", ["run", "branch", "cycles", "simulate", "plot", "problems"])
def test_help_has_examples(command):
    result = call(command, "--help")
    assert result.exit_code == 0 and f"hbbogie {command} " in result.stdout


def test_problems():
    result = call("problems")
    assert result.exit_code == 0
    for name in ("bautin", "duffing", "van_der_pol", "yang1995"):
        assert name in result.stdout
    rows = dict(document(call("problems", "--json"))["tables"][0]["rows"])
    assert "railway bogie" in rows["yang1995"]


def test_cycles_of_the_van_der_pol_oscillator():
    result = call("cycles", "van_der_pol", "--set", "mu=1", "--harmonics", 31, "--json")
    (cycle,) = document(result)["data"]["cycles"]
    assert cycle["period_s"] == pytest.approx(6.66328685932313019, rel=1e-6)
    assert cycle["amplitude"]["x"] == pytest.approx(2.00861986087484314, rel=1e-6)
    assert cycle["stability"] == "stable" and cycle["largest_multiplier"] == pytest.approx(8.59695e-4, rel=1e-3)
    assert cycle["parameters"] == {"mu": 1.0}


def test_a_method_by_its_name(tmp_path):
    """The exact fold of the bogie is known to ten digits; Bautin's cycles go round in 2 pi."""
    branch = call("branch", "yang1995", "--method", "exact", "--no-figures", "--output", tmp_path, "--json")
    assert any("'exact'" in note for note in document(branch)["notes"])
    assert Branch.load(tmp_path / "branch.nc").folds()[0].value == pytest.approx(88.7641131943, abs=5e-11)
    cycles = document(call("cycles", "bautin", "--method", "collocation", "--json"))["data"]["cycles"]
    assert all(c["method"].startswith("collocation") for c in cycles)
    assert [c["period_s"] for c in cycles] == pytest.approx([2 * np.pi] * 2, rel=1e-9)
    stiff = call("cycles", "van_der_pol", "--set", "mu=1000", "--method", "collocation", "--json")
    assert document(stiff)["data"]["cycles"][0]["period_s"] == pytest.approx(1614.401126, abs=5e-7)


def test_cycles_as_a_table_and_files(tmp_path):
    result = call("cycles", "bautin", "--output", tmp_path / "files")
    assert result.exit_code == 0
    for text in ("omega [rad/s]", "frequency [Hz]", "period [s]", "peak x [1]", "first harmonic y [1]"):
        assert text in result.stdout
    assert "unstable" in result.stdout and "looking for cycles" in result.stderr
    names = {f.name for f in (tmp_path / "files").iterdir()}
    assert {"cycle_1.nc", "cycle_2.nc", "cycles.csv", "phase_portrait.png"} <= names


def test_no_cycle_is_an_answer():
    result = call("cycles", "bautin", "--set", "mu=-0.3")
    assert result.exit_code == 0 and "No cycle found at mu = -0.3" in result.stdout


def test_run_writes_what_it_lists(tmp_path):
    listed = document(call("run", "bautin", "--output", tmp_path / "out", "--json"))["files"]
    assert sorted(listed) == sorted(str(f) for f in (tmp_path / "out").iterdir())
    for file in map(Path, listed):
        if file.suffix == ".png":
            assert file.read_bytes().startswith(PNG) and file.stat().st_size > 5000


def test_run_of_a_users_file_with_its_own_study(tmp_path):
    text = '''"""Mine."""
from hbbogie import Coordinate, Parameter, System
from hbbogie.reports import Report, Table

def mine(**values):
    x, k = Coordinate("x", "m"), Parameter("k", 1.0, "N/m")
    return System("mine", [x], [k], [x.ddot + k * x]).with_parameters(**values)

def study(system, progress):
    progress("thinking", 0.5)
    table = Table("answer", "Answer", ("k [N/m]", "what"), ((system.values["k"], None),), (".1f", ""))
    return Report("mine", (table,), notes=("A note.",))

SYSTEM = mine
'''
    (tmp_path / "mine.py").write_text(text)
    result = call("run", tmp_path / "mine.py", "--set", "k=2.5")
    assert result.exit_code == 0 and "thinking" in result.stderr
    assert "k [N/m]" in result.stdout and "2.5" in result.stdout and "A note." in result.stdout
    assert (tmp_path / "out" / "answer.csv").read_text() == "k [N/m],what\n2.5,\n"


def test_branch_and_plot(tmp_path):
    result = call("branch", "bautin", "--range", -0.3, 0.1, "--no-stability", "--output", tmp_path)
    assert result.exit_code == 0 and "fold" in result.stdout and "hopf" in result.stdout
    saved = Branch.load(tmp_path / "branch.nc")
    assert saved.values.max() == pytest.approx(0.1, abs=1e-9)
    result = call("plot", tmp_path / "branch.nc", "--coordinate", "y", "--output", tmp_path / "y.png")
    assert result.exit_code == 0
    assert (tmp_path / "y.png").read_bytes().startswith(PNG) and (tmp_path / "y.png").stat().st_size > 5000
    assert call("plot", tmp_path / "branch.nc", "--quantity", "first harmonic").exit_code == 0
    assert (tmp_path / "branch.png").is_file()


def test_plot_of_a_single_cycle(tmp_path):
    system = hbbogie.load_problem("van_der_pol").van_der_pol()
    (cycle,) = hbbogie.find_cycles(system)
    cycle.save(tmp_path / "cycle.nc")
    assert call("plot", tmp_path / "cycle.nc").exit_code == 0
    assert (tmp_path / "cycle.png").read_bytes().startswith(PNG)


def test_simulate(tmp_path):
    args = ("--start", "x=0.1", "--start", "x'=0.2", "--duration", 5, "--step", 0.01, "--output", tmp_path)
    settled = document(call("simulate", "van_der_pol", *args, "--json"))["data"]["settled"]
    assert settled["kind"] == "cycle"
    assert settled["omega_rad_s"] == pytest.approx(2 * np.pi / 6.66328685932313019, rel=1e-3)
    assert settled["amplitude"]["x"] == pytest.approx(2.00861986087484314, rel=1e-3)
    history = np.genfromtxt(tmp_path / "time_history.csv", delimiter=",", names=True, deletechars="")
    assert history.dtype.names == ("t_[s]", "x_[1]", "x'_[1/s]")
    np.testing.assert_allclose(history[0].tolist(), (0.0, 0.1, 0.2), rtol=1e-15)
    assert len(history) == 501 and (tmp_path / "time_history.png").is_file()


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["cycles", "yang1994"], "Did you mean 'yang1995'"),
        (["cycles", "nowhere.py"], "no problem file"),
        (["cycles", "yang1995", "--set", "VV=3"], "unknown parameter 'VV'. Did you mean 'V'"),
        (["cycles", "yang1995", "--set", "V"], "write NAME=VALUE"),
        (["cycles", "yang1995", "--set", "V=fast"], "'fast' is not a number"),
        (["cycles", "yang1995", "--set", "V=1", "--set", "V=2"], "given twice"),
        (["cycles", "yang1995", "--set", "V=-3"], "from 1 to 400 m/s"),
        (["branch", "yang1995", "--range", "100", "90"], "low < high"),
        (["branch", "yang1995", "--parameter", "Q"], "unknown parameter 'Q'"),
        (["simulate", "yang1995", "--start", "q9=1"], "unknown state 'q9'"),
        (["simulate", "yang1995", "--start", "q1"], "--start 'q1': write NAME=VALUE"),
        (["simulate", "yang1995", "--method", "euler"], "Allowed: rk4, cvodes"),
        (["cycles", "yang1995", "--method", "exakt"], "Did you mean 'exact'"),
        (["critical", "van_der_pol", "--method", "exact"], "no cycle in closed form"),
        (["run", "yang1995", "--method", "exact"], "does its own job"),
        (["plot", "nofile.nc"], "no file 'nofile.nc'"),
        (["run", "bautin", "--output", "taken"], "cannot write to the directory 'taken'"),
    ],
)
def test_wrong_input(args, message, tmp_path):
    (tmp_path / "taken").write_text("a file")
    result = call(*args)
    assert result.exit_code == 2
    assert result.stdout == "" and message in result.stderr and "Traceback" not in result.stderr
    result = call(*args, "--json")
    assert result.exit_code == 2 and message in json.loads(result.stdout)["error"]


def test_wrong_files_and_names_for_plot(tmp_path):
    (tmp_path / "text.nc").write_text("no NetCDF")
    assert call("plot", "text.nc").exit_code == 2
    call("branch", "bautin", "--no-stability", "--output", tmp_path)
    for option, message in (
        (("--coordinate", "z"), "unknown coordinate 'z'"),
        (("--quantity", "median"), "unknown quantity 'median'"),
        (("--output", "figure.xyz"), "ends in .png"),
    ):
        result = call("plot", "branch.nc", *option)
        assert result.exit_code == 2 and message in result.stderr


def test_numerical_failure():
    result = call("simulate", "van_der_pol", "--set", "mu=-1", "--start", "x=5", "--json")
    assert result.exit_code == 1 and "blew up" in json.loads(result.stdout)["error"]


def test_wrong_usage_is_json_too():
    run = process("cycles", "--json", "--nonsense")
    out, err = run.communicate(timeout=60)
    assert run.returncode == 2 and "--nonsense" in json.loads(out)["error"] and "--nonsense" in err


LOST = """
import os, signal, time
from hbbogie.parallel import interruptions
with interruptions(raising=True) as pressed:
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(50)
    except KeyboardInterrupt:
        pass  # as CasADi's conversions of arguments do
    try:
        time.sleep(50)
    except KeyboardInterrupt:
        print("raised again", pressed())
time.sleep(1.5)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such timer")
def test_a_lost_interruption_is_raised_again():
    run = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stdout, run.stderr) == (0, "raised again 1\n", "")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_interruption():
    run = process("simulate", "yang1995", "--duration", "1e4")
    while "integrating" not in (line := run.stderr.readline()):
        assert line or run.poll() is None, "the process ended before it began to integrate"
    time.sleep(0.5)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 130 and out == "" and "interrupted" in err and "Traceback" not in err


LONG_SEARCH = """
from hbbogie import load_problem

PARAMETER, RANGE = "mu", (-1.0, 0.5)


def SYSTEM():
    return load_problem("bautin").bautin(a=1.4)


def design(system):
    return {"over": {"a": (0.2, 2.0), "w0": (0.5, 2.0)}, "harmonics": 3}


from scipy import stats

from hbbogie.design import Uncertainty

UNCERTAIN = Uncertainty({"a": stats.norm(1, 0.1)})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_interruption_of_a_design_keeps_the_best_so_far(tmp_path):
    """The values that it leaves are those of a system with a higher critical value, -a^2 / 4."""
    (tmp_path / "search.py").write_text(LONG_SEARCH)
    run = process("design", str(tmp_path / "search.py"), "--output", str(tmp_path / "out"))
    while "design 2," not in (line := run.stderr.readline()):
        assert line or run.poll() is None, "the process ended before its second design"
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130 and "interrupted" in err and "Traceback" not in err
    values = tomllib.loads((tmp_path / "out" / "optimum.toml").read_text())
    assert 0.2 <= values["a"] < 1.4


def test_a_robust_design_from_the_shell(tmp_path):
    """The quantile of -a^2 x^2 / 4 is highest with the least a; three designs are judged by random ones."""
    (tmp_path / "search.py").write_text(LONG_SEARCH)
    given = ["--quantile", "0.1", "--designs", "4", "--samples", "6", "--json", "-q", "--no-figures"]
    found = document(call("design", tmp_path / "search.py", *given))
    assert found["data"]["converged"] and found["data"]["parameters"]["a"] == pytest.approx(0.2, abs=1e-9)
    (table,) = (t for t in found["tables"] if t["name"] == "robust")
    assert list(dict.fromkeys(row[0] for row in table["rows"])) == ["before", "nominal", "after"]
    for wrong, text in (
        (["--quantile", "2"], "between 0 and 1"),
        (["--quantile", "0.1", "--robust", "2"], "either"),
        (["--designs", "6"], "belongs to a quantile"),
        (["--samples", "-1"], "greater than or equal to 0"),
        (["--robust", "nan"], "finite number"),
        (["--start", tmp_path / "none.toml"], "--start"),
    ):
        result = call("design", tmp_path / "search.py", *wrong)
        assert result.exit_code == 2 and text in result.output


def test_figures_are_left_out_or_of_the_form_asked_for(tmp_path):
    for options, endings in ((["--no-figures"], set()), (["--format", "svg"], {".svg"})):
        folder = tmp_path / "".join(options)
        result = CliRunner().invoke(app, ["cycles", "van_der_pol", "--output", str(folder), *options])
        assert result.exit_code == 0, result.output
        assert {f.suffix for f in folder.iterdir()} == {".nc", ".csv"} | endings


@pytest.mark.parametrize("command", ["run", "cycles", "critical", "branch"])
def test_a_limit_of_time_is_told(command, tmp_path):
    where = ["--output", tmp_path / command]
    result = call(command, "yang1995", "--limit", "1e-6", "--json", *where)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["data"]["complete"] is False and "time limit" in result.stdout


def test_values_may_have_units():
    values = {}
    for text in ("V=90", "V=324 km/h", "V = 0.09 km/s"):
        values[text] = document(call("cycles", "yang1995", "--set", text, "--json", "--quiet"))["data"]["parameters"][
            "V"
        ]
    assert list(values.values()) == pytest.approx([90.0] * 3, rel=1e-14)
    wrong = call("cycles", "yang1995", "--set", "V=324 mph")
    assert wrong.exit_code == 2 and "'m/s', with or without a prefix, or km/h" in wrong.output


def test_quiet_shows_no_progress():
    assert "looking for cycles" in call("cycles", "van_der_pol").stderr
    assert call("cycles", "van_der_pol", "-q").stderr == ""


def test_a_new_problem_runs(tmp_path):
    """Its Hopf point in closed form: the friction falls as steeply as the damper rises, c = N mu0 (a - 3 b v^2)."""
    assert call("new", "my_belt.py").exit_code == 0
    again = call("new", "my_belt.py")
    assert again.exit_code == 2 and "exists already" in again.output
    assert call("new", "my-belt.py").exit_code == 2
    found = document(call("critical", "my_belt.py", "--json", "-q", "--no-figures"))
    values = [c["value"] for c in found["data"]["critical"] if c["kind"] == "hopf"]
    assert values == pytest.approx([(0.375 / 0.6) ** 0.5], rel=1e-9)


def test_alone_it_shows_its_help():
    run = process()
    out, _ = run.communicate(timeout=60)
    assert run.returncode == 0 and "hbbogie problems" in out


def test_set_takes_the_options_of_a_builder_that_are_texts():
    """Only in series does a yaw damper have the parameter kyd."""
    command = ["simulate", "vehicle", "--set", "yaw_dampers=series", "--set", "kyd=4 MN/m", "--start", "y1=0.001"]
    result = runner.invoke(app, [*command, "--duration", "0.1", "--no-figures", "--json"])
    assert result.exit_code == 0, result.output
    result = runner.invoke(app, ["cycles", "vehicle", "--set", "creep=nonsense"])
    assert result.exit_code == 2 and "give one of she, linear" in " ".join(result.output.split())
