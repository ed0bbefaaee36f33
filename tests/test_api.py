"""The public names: each documented, each parameter described, unknown keywords refused."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import hbbogie as hb

PUBLIC = [getattr(hb, name) for name in hb.__all__]
FUNCTIONS = [f for f in PUBLIC if inspect.isfunction(f)]
CLASSES = [c for c in PUBLIC if inspect.isclass(c) and not issubclass(c, Exception)]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_every_parameter_is_described(function):
    documentation = inspect.getdoc(function)
    assert "Parameters\n" in documentation
    described = documentation.split("Parameters\n")[1]
    for name in inspect.signature(function).parameters:
        assert name in described, f"{function.__name__}: {name}"


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_every_public_method_is_documented(cls):
    assert inspect.getdoc(cls)
    for name, member in vars(cls).items():
        if not name.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
            assert inspect.getdoc(member), f"{cls.__name__}.{name}"


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_fields_of_public_classes_are_documented(cls):
    documentation = inspect.getdoc(cls)
    fields = [f for f in getattr(cls, "__dataclass_fields__", {}) if not f.startswith("_")]
    for name in fields:
        assert name in documentation, f"{cls.__name__}: {name}"


def test_unknown_keywords_are_refused(bogie, balance, branch):
    with pytest.raises(TypeError):
        hb.trace(balance, branch.orbits[0], "V", (60.0, 190.0), stepp=1.0)
    with pytest.raises(TypeError):
        hb.HarmonicBalance(15, harmonic=3)
    for call in (
        lambda: hb.find_cycles(bogie, v=90.0),
        lambda: hb.solve(balance, branch.orbits[0], v=90.0),
        lambda: hb.simulate(bogie, {"q1": 0.01}, 1.0, v=90.0),
        lambda: hb.load_problem("yang1995").bogie(v=90.0),
    ):
        with pytest.raises(hb.ModelError, match=r"unknown parameter 'v'\. Did you mean 'V'\?"):
            call()


def test_import_is_lean():
    """Neither matplotlib nor xarray comes with the package; they are imported when asked for."""
    code = "import sys, hbbogie; print(sorted({'matplotlib', 'xarray', 'pandas'} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_version_is_that_of_the_distribution():
    from importlib.metadata import version

    assert version("hbbogie") == hb.__version__
