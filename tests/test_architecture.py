"""The shape of the package: who imports whom, how long things are."""

from __future__ import annotations

import ast
import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hbbogie

PACKAGE = Path(hbbogie.__file__).parent
ROOT = PACKAGE.parent
WINGS = sorted(p.parent.name for p in PACKAGE.glob("*/__init__.py") if p.parent.name != "problems")
OUTSIDE = [p for folder in ("problems", "tests", "docs") for p in (ROOT / folder).rglob("*.py")]


def _modules():
    return [p for p in sorted(PACKAGE.rglob("*.py")) if p.relative_to(PACKAGE).parts[0] != "problems"]


def test_imports_keep_to_the_layers():
    """The contracts stand in pyproject.toml."""
    linter = Path(sys.executable).with_name("lint-imports")
    command = str(linter) if linter.exists() else shutil.which("lint-imports")
    assert command, "import-linter is part of the extra 'test'"
    run = subprocess.run([command], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize("wing", WINGS)
def test_wing_has_a_face(wing):
    """It says what it is for, and every name in ``__all__`` is there and is no module."""
    face = importlib.import_module(f"hbbogie.{wing}")
    assert len(face.__doc__.strip().splitlines()) >= 3
    assert face.__all__
    for name in face.__all__:
        assert type(getattr(face, name)).__name__ != "module", name


def test_no_function_has_the_name_of_a_wing_or_of_a_module_beside_it():
    """Else importing the module would hide the function."""
    for folder in (PACKAGE, *(PACKAGE / wing for wing in WINGS)):
        face = importlib.import_module(".".join(folder.relative_to(ROOT).parts))
        names = set(face.__all__) - (set(WINGS) if folder == PACKAGE else set())
        modules = {p.stem for p in folder.glob("*.py")} | set(WINGS)
        assert not names & modules


def test_outside_code_imports_from_faces():
    """Private names aside, which tests may look at."""
    for path in OUTSIDE:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.count(".") > 1:
                inside = node.module.startswith("hbbogie.") and not node.module.startswith("hbbogie.problems")
                public = [a.name for a in node.names if not a.name.startswith("_")]
                assert not (inside and public), f"{path.name}: {public} from {node.module}"


def test_modules_and_functions_are_short():
    for path in _modules():
        text = path.read_text()
        assert text.count("\n") <= 350, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                documentation = ast.get_docstring(node, clean=False) or ""
                length = node.end_lineno - node.lineno - documentation.count("\n")
                assert length <= 65, f"{path.name}: {node.name} has {length} lines without its docstring"
