"""The documentation: its code runs, what it points to exists."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path

import matplotlib
import matplotlib.pyplot
import pytest
from typer.testing import CliRunner

import hbbogie
from hbbogie.commandline import app
from hbbogie.model import shipped_problems

matplotlib.use("Agg")
ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
WIDTH = 105  # characters of a line of code that the pages show without folding it
MADE = DOCS / "generated"  # by a build of the pages
PAGES = [ROOT / "README.md", *sorted(p for p in DOCS.rglob("*.md") if MADE not in p.parents)]
NOTEBOOKS = sorted(DOCS.glob("notebooks/*.ipynb"))
CODE = re.compile(r"```(?:python|\{code-block\} python)\n(.*?)```", re.DOTALL)
RUN = re.compile(r"```python\n(.*?)```", re.DOTALL)


def blocks_of(page):
    """The code of a page or notebook that runs, block by block."""
    text = page.read_text("utf-8")
    if page.suffix == ".md":
        return RUN.findall(text)
    return ["".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("page", [p for p in [*PAGES, *NOTEBOOKS] if blocks_of(p)], ids=lambda p: p.name)
def test_code_runs(page, tmp_path, monkeypatch):
    """All blocks of a page in their order, in one namespace."""
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "page"}
    for block in blocks_of(page):
        exec(compile(block, str(page), "exec", dont_inherit=True), namespace)
    matplotlib.pyplot.close("all")


@pytest.mark.parametrize("page", [*PAGES, *NOTEBOOKS], ids=lambda p: p.name)
def test_code_fits_its_box(page):
    blocks = CODE.findall(page.read_text("utf-8")) if page.suffix == ".md" else blocks_of(page)
    assert [line for block in blocks for line in block.splitlines() if len(line) > WIDTH] == []


@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda p: p.name)
def test_notebooks_are_kept_without_output(page):
    for cell in json.loads(page.read_text("utf-8"))["cells"]:
        assert not cell.get("outputs") and cell.get("execution_count") is None


def test_every_problem_has_its_picture_in_the_gallery():
    """If one is missing: ``python docs/make_figures.py gallery``."""
    for name in shipped_problems():
        assert (DOCS / "images" / f"gallery_{name}.png").stat().st_size < 200_000


def test_commands_are_written_from_the_application(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS / "extensions"))
    text = importlib.import_module("generated_pages").commands_page()
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        assert f"## `hbbogie {name}`" in text
        assert re.search(rf"^\* `{name}`: .+\.$", text, re.MULTILINE), name
    assert "### `hbbogie study run`" in text


def test_terms_are_in_the_glossary():
    terms = set(re.findall(r"^([A-Za-z][A-Za-z -]*)\n  \S", (DOCS / "glossary.md").read_text("utf-8"), re.MULTILINE))
    assert len(terms) > 30
    for page in [*PAGES, *NOTEBOOKS]:
        used = re.findall(r"\{term\}`(?:[^`<]+<)?([^`<>]+)>?`", page.read_text("utf-8"))
        assert set(used) <= terms, page


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
        assert (page.parent / target).exists() or MADE in (page.parent / target).resolve().parents, target


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


def test_every_wing_has_its_page_in_the_reference():
    """The modules beside the wings, and what is imported from `hbbogie` itself, stand on the first page."""
    reference, package = (DOCS / "api.md").read_text("utf-8"), ROOT / "hbbogie"
    wings = {path.parent.name for path in package.glob("*/__init__.py")} - {"problems"}
    for wing in wings:
        page = (DOCS / "api" / f"{wing}.md").read_text("utf-8")
        assert f".. automodule:: hbbogie.{wing}\n   :members:\n" in page
    assert {path.stem for path in (DOCS / "api").glob("*.md")} == wings
    for module in {path.stem for path in package.glob("*.py")} - {"__init__", "__main__"}:
        assert f".. automodule:: hbbogie.{module}\n" in reference
    for name in set(hbbogie.__all__) - wings:
        assert f"`{name}`" in reference, name
