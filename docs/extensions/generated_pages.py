"""Pages that are written anew at every build: the commands, and the gallery of the problems.

They stand in ``docs/generated``, which is not kept. The commands come from the application itself, the gallery from
the problem files and the pictures that ``make_figures.py`` draws of them.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.cli import get_docs_for_click

from hbbogie.commandline import app as application
from hbbogie.model import default_interval, load_problem, shipped_problems, system_of

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx

DOCS = Path(__file__).parent.parent
LINKED = {
    "ndarray": "numpy.ndarray",
    "xarray.Dataset": "xarray.Dataset",
    "casadi.Function": "casadi.Function",
    "casadi.SX": "casadi.SX",
    "Figure": "matplotlib.figure.Figure",
    "Axes": "matplotlib.axes.Axes",
}


def commands_page() -> str:
    """Return the reference of the command line, made by Typer from the application."""
    command = typer.main.get_command(application)
    context = typer.Context(command, info_name="hbbogie")
    text = get_docs_for_click(obj=command, ctx=context, name="hbbogie", title="Commands")
    text = re.sub(r"^\* `--help`.*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^\*\*Options\*\*:\n\n(?=\n|\*\*|Examples)", "", text, flags=re.MULTILINE)
    text = re.sub(r"^Begin with: (.+)\n\nthen: (.+)$", r"```console\n$ \1\n$ \2\n```", text, flags=re.MULTILINE)
    text = re.sub(r"^Examples:\n((?:\n(?!#|\*\*).+\n)+)", _examples, text, flags=re.MULTILINE)
    whole = dict(re.findall(r"^#+ `hbbogie (.+)`\n\n(.+)", text, re.MULTILINE))  # the lists cut these sentences short

    def uncut(line: re.Match[str]) -> str:
        name, start = line[1], line[2].removesuffix("...")
        full = [(path, s) for path, s in whole.items() if path.split()[-1] == name and s.startswith(start)]
        return "* `{}`: {}".format(*full[0]) if full else line[0]

    return re.sub(r"^\* `([a-z]+)`: (.+)$", uncut, text, flags=re.MULTILINE)


def _examples(found: re.Match[str]) -> str:
    lines = [line.removeprefix("then: ") for line in found[1].splitlines() if line]
    return "**Examples**:\n\n```console\n" + "\n".join(f"$ {line}" for line in lines) + "\n```\n"


def picture_of(name: str) -> str:
    """Return the picture of a problem: a moving one, where there is one; nothing, where none is drawn yet."""
    drawn = [p for p in (f"{name}_hunting.gif", f"gallery_{name}.png") if (DOCS / "images" / p).exists()]
    return drawn[0] if drawn else ""


def image_of(name: str) -> str:
    """Return the line of a card that shows its picture."""
    return f":img-top: ../../images/{picture_of(name)}\n" if picture_of(name) else ""


def title_of(name: str) -> str:
    """Return the first line of a problem's docstring, without its full stop."""
    return (load_problem(name).__doc__ or name).strip().splitlines()[0].rstrip(".")


def problem_page(name: str) -> str:
    """Return the page of a problem: what its file says, its picture, its parameters and its source."""
    module, system = load_problem(name), system_of(load_problem(name))
    text = "\n".join((module.__doc__ or "").strip().splitlines()[1:])
    text = re.sub(r"(?m)(?:^ {4,}.*\n(?:\n(?= {4}))?)+", lambda m: f"```text\n{m[0].rstrip()}\n```\n", text)
    source = Path(module.__file__ or "")
    files = [source] if source.name != "__init__.py" else sorted(source.parent.glob("*.py"))
    rows = [f"| `{p.name}` | {p.default:g} | {p.unit} | {p.description} |" for p in system.parameters]
    parameter, (low, high) = default_interval(module, system)
    lines = [
        f"# {title_of(name)}",
        "",
        f"![The first picture of the job](../../images/gallery_{name}.png)" if picture_of(name) else "",
        "",
        text,
        "",
        "```bash",
        f"hbbogie run {name} --output out",
        f"hbbogie branch {name} --range {low:g} {high:g}  # over {parameter}",
        "```",
        "",
        "| parameter | default | unit | meaning |",
        "|---|--:|---|---|",
        *rows,
    ]
    for file in files:
        path = file.relative_to(DOCS.parent).as_posix()
        lines += ["", f"## `{path}`", "", f"```{{literalinclude}} ../../../{path}", "```"]
    return "\n".join([*lines, ""])


def gallery_page() -> str:
    """Return the gallery: a card for each problem."""
    names = shipped_problems()
    cards = [
        f":::{{grid-item-card}} {name}\n{image_of(name)}:link: {name}\n:link-type: doc\n\n{title_of(name)}.\n:::\n"
        for name in names
    ]
    return "\n".join(
        [
            "# Gallery",
            "",
            "Every problem that comes with the package, with the first picture of its job. Click on one for its",
            "equations, its parameters and its file. `hbbogie run NAME` draws the picture again, and more.",
            "",
            "::::{grid} 1 2 2 3",
            ":gutter: 3",
            "",
            *cards,
            "::::",
            "",
            "```{toctree}",
            ":hidden:",
            "",
            *(f"{name} <{name}>" for name in names),
            "```",
            "",
        ]
    )


def write_pages(app: Sphinx) -> None:
    """Write the pages into the folder ``generated``."""
    folder = Path(app.srcdir) / "generated"
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "gallery").mkdir(parents=True)
    pages = {"commands": commands_page(), "gallery/index": gallery_page()}
    pages |= {f"gallery/{name}": problem_page(name) for name in shipped_problems()}
    for name, text in pages.items():
        (folder / f"{name}.md").write_text(text, "utf-8")


def link_types(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Make the types of other packages in a docstring links into their documentation."""
    for short, full in LINKED.items():
        pattern = re.compile(rf"^(\s*(?:[\w, *]+ : )?){re.escape(short)}(?=$|,| or )")
        lines[:] = [pattern.sub(rf"\1:py:class:`{short} <{full}>`", line) for line in lines]


def unlink_words(app: Sphinx, doctree: nodes.document) -> None:
    """Make words of a type, such as "unit" in "float, unit of force", no links to attributes of that name."""
    from sphinx.addnodes import pending_xref

    for reference in list(doctree.findall(pending_xref)):
        target = reference.get("reftarget", "")
        if (
            reference.get("refdomain") == "py"
            and reference.get("reftype") == "class"
            and re.fullmatch("[a-z_]+", target)
        ):
            reference.replace_self(reference.children)


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages when a build begins."""
    app.connect("builder-inited", write_pages)
    app.connect("doctree-read", unlink_words)
    app.connect("autodoc-process-docstring", link_types, priority=400)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
