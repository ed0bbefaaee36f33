"""The documentation: its code runs, what it points to exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
CODE = re.compile(r"```python\n(.*?)```", re.DOTALL)


@pytest.mark.parametrize("page", [p for p in PAGES if CODE.search(p.read_text())], ids=lambda p: p.name)
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "page"}
    for block in CODE.findall(page.read_text()):
        exec(compile(block, str(page), "exec"), namespace)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_images_and_pages_exist(page):
    for target in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_equation_labels_quoted_in_the_code_exist():
    labels = set(re.findall(r"^\$\$ \((eq-[a-z-]+)\)", (ROOT / "docs" / "theory.md").read_text(), re.MULTILINE))
    quoted = set()
    for path in (ROOT / "hbbogie").rglob("*.py"):
        quoted |= set(re.findall(r"\beq-[a-z]+(?:-[a-z]+)*", path.read_text()))
    assert quoted and quoted <= labels


def test_readme_has_the_two_commands():
    text = (ROOT / "README.md").read_text()
    for marker in ("<!-- run-command -->", "<!-- test-command -->"):
        assert re.search(re.escape(marker) + r"\n```bash\npython3 -m venv", text)


def test_every_module_is_in_the_reference():
    reference = (ROOT / "docs" / "api.md").read_text()
    for path in (ROOT / "hbbogie").rglob("*.py"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if not name.endswith("__main__") and "hbbogie.problems" not in name:
            assert f"automodule:: {name}\n" in reference, name
