"""Formulas as MathML, which browsers draw themselves: no script and no network."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.locale import _
from sphinx.util.math import get_node_equation_number


def multiline(text: str) -> str:
    """Return a formula of several lines as one that the converter aligns at its marks."""
    text = re.sub(r"\\\\\[[^]]*\]", r"\\\\", text)  # the converter knows no extra space between lines
    if r"\\" in text and r"\begin" not in text:
        return rf"\begin{{split}}{text}\end{{split}}"
    return text.replace("{aligned}", "{split}")


def inline(self: Any, node: nodes.math) -> None:
    """Write a formula in a line of text."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """Write a displayed formula with its number and a link to itself."""
    self.body.append(self.starttag(node, "div", CLASS="math formula"))
    self.body.append(convert(multiline(node.astext()), display="block"))
    if node["number"]:
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})')
        self.add_permalink_ref(node, _("Link to this equation"))
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
