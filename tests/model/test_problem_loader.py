import multiprocessing
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from hbbogie import sweep
from hbbogie.errors import ModelError
from hbbogie.model import System, load_problem, problem, shipped_problems, system_of
from hbbogie.studies import load_study

GOOD = '''"""A pendulum."""
from hbbogie import Coordinate, Parameter, System

def pendulum(g=9.81):
    x, k = Coordinate("x"), Parameter("g", 9.81)
    return System("pendulum", [x], [k], [x.ddot + k * x]).with_parameters(g=g)

SYSTEM = pendulum
'''


def write(folder, text, name="mine.py"):
    path = folder / name
    path.write_text(text)
    return path


def test_shipped_problems():
    assert set(shipped_problems()) >= {"yang1995", "van_der_pol", "duffing", "bautin", "gap_oscillator", "piecewise"}
    assert list(shipped_problems()) == sorted(shipped_problems())


def test_a_problem_is_loaded_once():
    first = load_problem("van_der_pol")
    assert load_problem("van_der_pol") is first
    assert load_problem(first.__file__) is first
    assert sys.modules["hbbogie_problem_van_der_pol"] is first


def test_a_file_of_the_user(tmp_path, monkeypatch):
    path = write(tmp_path, GOOD)
    module = load_problem(path)
    assert isinstance(system_of(module), System)
    assert system_of(module, g=1.6).values == {"g": 1.6}
    monkeypatch.chdir(tmp_path)
    assert load_problem("mine.py") is module
    other = tmp_path / "other"
    other.mkdir()
    assert load_problem(write(other, GOOD)) is not module


def test_a_file_of_the_user_comes_before_a_shipped_problem(tmp_path, monkeypatch):
    write(tmp_path, GOOD, "duffing.py")
    monkeypatch.chdir(tmp_path)
    assert hasattr(load_problem("duffing.py"), "pendulum")
    assert hasattr(load_problem("duffing"), "backbone")


def test_unknown_names():
    with pytest.raises(ModelError, match=r"Did you mean 'yang1995'\?.*van_der_pol.*path of a \.py file"):
        load_problem("yang1994")
    with pytest.raises(ModelError, match=r"no problem file 'nowhere/mine\.py'.*yang1995"):
        load_problem("nowhere/mine.py")


def test_the_installed_copy_comes_before_the_checkout(tmp_path, monkeypatch):
    package = tmp_path / "hbbogie"
    (package / "problems").mkdir(parents=True)
    write(package / "problems", GOOD, "wheel_only.py")
    write(package / "problems", "", "_hidden.py")
    monkeypatch.setattr(problem, "__file__", str(package / "model" / "problem.py"))
    assert shipped_problems() == ("wheel_only",)
    assert load_problem("wheel_only").__name__ == "hbbogie_problem_wheel_only"
    monkeypatch.delitem(sys.modules, "hbbogie_problem_wheel_only")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\ny = 1 / 0\n", "line 2 cannot be loaded: ZeroDivisionError: division by zero"),
        ("x = 1\n\ny = = 2\n", "line 3 cannot be loaded: SyntaxError: invalid syntax"),
        ("def f():\n    import json\n    json.loads('[')\nf()\n", "line 3 cannot be loaded: JSONDecodeError"),
        ("import sys\nsys.exit('no')\n", "line 2 cannot be loaded: SystemExit: no"),
    ],
)
def test_an_error_in_the_file_names_its_line(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(ModelError) as caught:
        load_problem(path)
    assert message in str(caught.value) and str(path) in str(caught.value)
    assert caught.value.__cause__ is not None
    path.write_text(GOOD)  # what failed is not kept
    assert load_problem(path).SYSTEM().n == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", "has no SYSTEM"),
        ("SYSTEM = 3", "SYSTEM is of type int; it must be a function"),
        ("def f():\n    return 3\nSYSTEM = f", r"f\(\) returned an object of type int"),
        ("def f():\n    return {}['a']\nSYSTEM = f", "line 2 cannot build its system: KeyError: 'a'"),
    ],
)
def test_a_module_without_a_proper_builder(tmp_path, text, message):
    with pytest.raises(ModelError, match=message):
        system_of(load_problem(write(tmp_path, text)))


def test_an_unknown_keyword_of_a_builder(tmp_path):
    module = load_problem(write(tmp_path, GOOD))
    with pytest.raises(ModelError, match=r"unknown parameter 'gg'\. Did you mean 'g'"):
        system_of(module, gg=1.0)


def test_functions_and_data_pickle():
    module = load_problem("van_der_pol")
    assert pickle.loads(pickle.dumps(module.van_der_pol)) is module.van_der_pol
    assert pickle.loads(pickle.dumps(module.PUBLISHED)) == module.PUBLISHED
    assert pickle.loads(pickle.dumps(module.van_der_pol(mu=3.0))).values == {"mu": 3.0}


def test_a_worker_started_afresh_unpickles_the_builder(tmp_path):
    path = write(tmp_path, GOOD)
    builder = load_problem(path).SYSTEM
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, fresh, initializer=load_problem, initargs=(str(path),)) as pool:
        assert pool.submit(builder, 2.5).result().values == {"g": 2.5}
    assert Path(path).is_file()


# --- problems that are folders ----------------------------------------------------------------

FACE = '"""A pendulum."""\nfrom .build import SYSTEM, pendulum\nfrom .jobs import stiffness\n'
BUILD = GOOD.replace("from hbbogie", "from .gravity import G\nfrom hbbogie").replace("g=9.81", "g=G")
JOBS = "from .gravity import G\n\ndef stiffness(system):\n    return {'k': system.values['g'], 'G': G}\n"


def write_folder(folder, gravity="9.81"):
    folder.mkdir()
    for name, text in (("__init__", FACE), ("build", BUILD), ("jobs", JOBS), ("gravity", f"G = {gravity}\n")):
        (folder / f"{name}.py").write_text(text)
    return folder


def test_a_folder_of_the_user(tmp_path, monkeypatch):
    folder = write_folder(tmp_path / "mine")
    module = load_problem(folder)
    assert system_of(module).values == {"g": 9.81} and system_of(module, g=1.6).values == {"g": 1.6}
    assert load_problem(folder / "__init__.py") is module
    monkeypatch.chdir(tmp_path)
    assert load_problem("mine") is module and load_problem("./mine/") is module
    write_folder(tmp_path / "duffing")
    assert hasattr(load_problem("duffing"), "backbone")
    assert hasattr(load_problem("./duffing"), "pendulum")


def test_a_folder_is_loaded_afresh_when_a_module_of_it_changes(tmp_path):
    folder = write_folder(tmp_path / "mine")
    assert load_problem(folder).SYSTEM().values == {"g": 9.81}
    (folder / "gravity.py").write_text("G = 1.62\n")  # as long, and within the same second
    assert load_problem(folder).SYSTEM().values == {"g": 1.62}


def test_an_error_in_a_folder_names_file_and_line(tmp_path):
    folder = write_folder(tmp_path / "mine", "1 / 0")
    with pytest.raises(ModelError, match=r"mine/gravity\.py, line 1 cannot be loaded: ZeroDivisionError"):
        load_problem(folder)
    (folder / "gravity.py").write_text("G = = 1\n")
    with pytest.raises(ModelError, match=r"mine/gravity\.py, line 1 cannot be loaded: SyntaxError"):
        load_problem(folder)
    (folder / "gravity.py").write_text("G = 1.62\n")
    assert load_problem(folder).SYSTEM().values == {"g": 1.62}
    (folder / "build.py").write_text("def SYSTEM():\n    return {}['a']\npendulum = SYSTEM\n")
    with pytest.raises(ModelError, match=r"mine/build\.py, line 2 cannot build its system: KeyError"):
        system_of(load_problem(folder))


def test_a_shipped_folder_is_one_problem(tmp_path, monkeypatch):
    assert shipped_problems().count("yang1995") == 1
    package = tmp_path / "hbbogie"
    (package / "problems").mkdir(parents=True)
    write_folder(package / "problems" / "mine")
    (package / "problems" / "studies").mkdir()
    monkeypatch.setattr(problem, "__file__", str(package / "model" / "problem.py"))
    assert shipped_problems() == ("mine",)
    module = load_problem("mine")
    assert module.__name__ == "hbbogie_problem_mine" and module.SYSTEM().n == 1
    for name in [n for n in sys.modules if n.partition(".")[0] == module.__name__]:
        monkeypatch.delitem(sys.modules, name)


def test_workers_started_afresh_know_the_functions_of_a_folder(tmp_path):
    folder = write_folder(tmp_path / "mine")
    module = load_problem(folder)
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, fresh, initializer=load_problem, initargs=(str(folder),)) as pool:
        assert pool.submit(module.pendulum, 2.5).result().values == {"g": 2.5}


@pytest.mark.parametrize("how", ["function", "file"])
def test_a_job_of_a_folder_runs_in_workers(tmp_path, monkeypatch, how):
    folder = write_folder(tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    job = load_problem(folder).stiffness if how == "function" else f"{folder}/__init__.py:stiffness"
    data = sweep(job, {"g": [1.0, 2.0]}, problem="mine", workers=2)
    assert data["k"].values.tolist() == [1.0, 2.0] and data["G"].values.tolist() == [9.81, 9.81]


def test_a_study_file_names_a_folder_beside_it(tmp_path):
    write_folder(tmp_path / "mine")
    text = (
        'problem = "mine"\njob = "mine/__init__.py:stiffness"\n[points]\nsample = "grid"\nparameters.g = [1.0, 2.0]\n'
    )
    study = load_study(write(tmp_path, text, "mine.toml"))
    data = sweep(study.job, study.points, problem=study.problem)
    assert study.problem == str(tmp_path / "mine") and data["k"].values.tolist() == [1.0, 2.0]
