import multiprocessing
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from hbbogie.errors import ModelError
from hbbogie.model import System, load_problem, problem, shipped_problems, system_of

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
