"""Reports as pages: a summary from the numbers, what was computed, and nothing on them that is for machines."""

from __future__ import annotations

import html
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from hbbogie import ModelError, critical_speeds, load_problem
from hbbogie.branches import bifurcation_diagram
from hbbogie.commandline import app
from hbbogie.equilibria import find_equilibria
from hbbogie.reports import (
    Origin,
    Report,
    Table,
    diagram_sentences,
    html_of,
    influence_sentences,
    rest_pieces,
    write_html,
)


def _text(page):
    """What a reader sees, tags and pictures left out."""
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<style>.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL)))


@pytest.fixture(scope="module")
def bautin():
    system = load_problem("bautin").bautin(a=0.8)
    return system, bifurcation_diagram(system, "mu", (-0.3, 0.2), harmonics=3)


# --- sentences ---------------------------------------------------------------------------------


def test_where_rest_and_cycles_coexist(bautin):
    """From the fold at -a^2 / 4 to the Hopf point at 0; cycles have radius^2 = (a + sqrt(a^2 + 4 mu)) / 2."""
    said = " ".join(diagram_sentences(*bautin))
    assert "Between mu = -0.16 and 0 1/s a large disturbance starts oscillation" in said
    assert "Hopf point at mu = 0 1/s: the cycles that begin here are unstable" in said
    radius = np.sqrt((0.8 + np.sqrt(0.8**2 + 4 * 0.2)) / 2)
    assert f"at mu = 0.2 1/s, has a peak of {radius:.4g} of" in said


def test_what_moves_the_fold(bautin):
    """The fold at -a^2 / 4 moves by -a da / 2: raising a = 0.8 by a tenth by -0.032."""
    system, _ = bautin
    (said,) = (s for s in influence_sentences(system, critical_speeds(system, "mu", (-0.3, 0.2))) if "fold" in s)
    assert "cubic coefficient a by 10 % moves it by \N{MINUS SIGN}0.032 1/s" in said


def test_lines_of_equilibria_meet_at_the_hopf_point():
    system = load_problem("bautin").bautin()
    (branch,) = find_equilibria(system, "mu", (-0.3, 0.2))
    (first, before), (second, after) = rest_pieces(branch, lambda o: 0.0)
    assert (first, second) == ("stable", "unstable")
    assert before[-1] == pytest.approx([0.0, 0.0], abs=1e-12) and (after[0] == before[-1]).all()


# --- pages -------------------------------------------------------------------------------------


def test_numbers_have_sensible_digits_and_units():
    rows = (("K1", 3.1234567e6, "N/m", 0.00912345678), ("m", 12.0, "kg", 1.0))
    table = Table("t", "Sizes", ("name", "value", "unit", "peak q [m]"), rows, ("", ".8g", "", ".8g"))
    text = _text(html_of(Report("Title", (table,), notes=("Said.",))))
    assert "K1 3.1235 MN/m" in text and "12 kg" in text
    wide = Table("t", "Wide", tuple(f"c{i} [m]" for i in range(12)), ((0.0012345678,) * 12,), (".8g",) * 12)
    assert "c3 [mm] 1.2346" in _text(html_of(Report("Title", (wide,))))  # turned: a line for each column


def test_long_tables_are_thinned_and_say_so():
    table = Table("t", "Long", ("n",), tuple((i,) for i in range(500)), ("d",))
    text = _text(html_of(Report("Title", (table,))))
    assert "of 500 rows" in text and " 499 " not in text


def test_text_is_escaped():
    page = html_of(Report("<b>x</b>", (Table("t", "a < b", ("c",), (("<script>",),), ("",)),), notes=("1 < 2",)))
    assert "<script>" not in page and "<b>" not in page and "&lt;script&gt;" in page


def test_what_was_changed_is_said():
    module = load_problem("yang1995")
    system = module.bogie(K2=1.2e7)
    page = html_of(Report("Title", summary=("Said.",)), Origin(system, dict(module.bogie().values), "hbbogie run"))
    assert "Changed from the problem's own values: K2 = 12 MN/m." in _text(page)


def test_a_page_needs_the_ending_of_one(tmp_path):
    with pytest.raises(ModelError, match=r"ends in \.html"):
        write_html(Report("Title"), tmp_path / "page.txt")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["branch", "bautin", "--harmonics", "3", "--set", "a=0.8"], "Between mu = -0.16 and 0 1/s a large"),
        (["cycles", "bautin", "--harmonics", "3"], "There are 2 cycles at mu = -0.1 1/s."),
        (["critical", "bautin"], "To first order, raising cubic coefficient a by 10 % moves it by"),
    ],
)
def test_commands_write_pages(words, said, tmp_path):
    page = tmp_path / "out.html"
    options = ["--report", str(page), "--no-figures"]
    options += ["--output", str(tmp_path / "files")] if words[0] != "cycles" else []
    result = CliRunner().invoke(app, [*words, *options])
    assert result.exit_code == 0, result.output
    content = page.read_text("utf-8")
    first, _, details = _text(content).partition(" Details ")
    assert said in first and "What was computed" in first
    for word in ("{", "hash", str(tmp_path)):
        assert word not in first, word
    assert "How to compute it again" in details and str(tmp_path) not in details
    assert " ".join(words) in details
    assert not re.findall(r"(?:src|href)=\"(?!data:)", content)


def test_a_page_that_cannot_be_written_is_told_at_once(tmp_path):
    result = CliRunner().invoke(app, ["cycles", "bautin", "--report", str(tmp_path / "out.pdf")])
    assert result.exit_code == 2 and "ends in .html" in result.output
