"""The documentation: its code runs, what it points to exists."""

from __future__ import annotations

import json
import re
from pathlib import Path

import matplotlib
import pytest
from typer.testing import CliRunner

from hbbogie.commandline import app

matplotlib.use("Agg")
ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
CODE = re.compile(r"```python\n(.*?)```", re.DOTALL)


@pytest.mark.parametrize("page", [p for p in PAGES if CODE.search(p.read_text("utf-8"))], ids=lambda p: p.name)
def test_code_runs(page, tmp_path, monkeypatch):
    """All blocks of a page in their order, in one namespace."""
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "page"}
    for block in CODE.findall(page.read_text("utf-8")):
        exec(compile(block, str(page), "exec"), namespace)


def example_file():
    text = (DOCS / "problems.md").read_text("utf-8")
    block = re.search(r"<!-- my_problem.py -->\n```python\n(.*?)```", text, re.DOTALL)
    assert block, "problems.md shows no complete file"
    return block[1]


def test_example_file_runs_by_its_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my_problem.py").write_text(example_file(), "utf-8")
    result = CliRunner().invoke(app, ["cycles", "my_problem.py", "--set", "g=2.5", "--json"])
    assert result.exit_code == 0, result.output
    (cycle,) = json.loads(result.stdout)["data"]["cycles"]
    assert cycle["stability"] == "stable" and cycle["amplitude"]["x"] > 0.01
    result = CliRunner().invoke(app, ["cycles", "my_problem.py", "--set", "m=-1", "--json"])
    assert result.exit_code == 2


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_images_and_pages_exist(page):
    for target in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", page.read_text("utf-8")):
        assert (page.parent / target).exists(), target


def test_images_are_small():
    for page in PAGES:
        for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text("utf-8")):
            assert (page.parent / target).stat().st_size < 200_000, target


def test_equation_labels():
    """Those quoted in the code and on the pages exist; the table of labels holds each of them, and no other."""
    theory = (DOCS / "theory.md").read_text("utf-8")
    labels = re.findall(r"^\$\$ \((eq-[a-z-]+)\)", theory, re.MULTILINE)
    assert len(labels) == len(set(labels))
    assert re.findall(r"^\| `(eq-[a-z-]+)` \|", theory, re.MULTILINE) == labels
    quoted = set()
    for path in [*(ROOT / "hbbogie").rglob("*.py"), *(ROOT / "problems").rglob("*.py")]:
        quoted |= set(re.findall(r"\beq-[a-z]+(?:-[a-z]+)*", path.read_text("utf-8")))
    assert quoted
    for page in PAGES:
        quoted |= set(re.findall(r"\{eq\}`([^`]+)`", page.read_text("utf-8")))
    assert quoted <= set(labels)


def test_modules_in_the_table_of_labels_exist():
    theory = (DOCS / "theory.md").read_text("utf-8")
    for row in re.findall(r"^\| `eq-[a-z-]+` \|[^|]*\|([^|]*)\|", theory, re.MULTILINE):
        for name in re.findall(r"`([^`]+)`", row):
            assert (ROOT / "hbbogie" / f"{name.replace('.', '/')}.py").is_file(), name


def test_readme_has_the_two_commands():
    text = (ROOT / "README.md").read_text("utf-8")
    for marker in ("<!-- run-command -->", "<!-- test-command -->"):
        assert re.search(re.escape(marker) + r"\n```bash\npython3 -m venv", text)


def test_commands_of_the_readme_exist():
    commands = set(re.findall(r"^\| `hbbogie ([a-z]+)", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE))
    registered = {c.name or c.callback.__name__ for c in app.registered_commands}
    registered |= {group.name for group in app.registered_groups}
    assert commands == registered


def test_every_module_is_in_the_reference():
    reference = (DOCS / "api.md").read_text("utf-8")
    for path in (ROOT / "hbbogie").rglob("*.py"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if not name.endswith("__main__") and "hbbogie.problems" not in name:
            assert f"automodule:: {name}\n" in reference, name
