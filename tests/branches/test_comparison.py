"""Describing function or multi-harmonic balance: the comparison, on any problem and on Yang's paper."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import compare, exact_crossings, exact_walk, method_named
from hbbogie.reports import comparison_of, table_of_errors, table_of_methods, verdicts

SILENT = lambda message, fraction: None  # noqa: E731


@pytest.fixture(scope="module")
def found(bogie):
    return compare(
        bogie, ("df1", "mhb3", "mhb15"), (90.0, 127.81, 184.46), parameter="V", interval=(60.0, 190.0), truth="mhb41"
    )


@pytest.fixture(scope="module")
def report(bogie):
    yang = hb.load_problem("yang1995")
    return comparison_of(yang, bogie, ("df1", "df2", "mhb15"))


def test_one_harmonic_is_exact_for_a_circular_cycle():
    """Bautin's cycles are circles: one harmonic is all there is (SOLVER)."""
    system = hb.load_problem("bautin").bautin()
    circle = compare(system, ("df1", "mhb1", "mhb3"), (-0.2, 0.1), interval=(-0.3, 0.2), truth="mhb5")
    assert {(row.value, row.part) for row in circle.rows} == {(-0.2, 0), (-0.2, 1), (0.1, 1)}
    for row in circle.rows:
        for name in circle.approximations:
            assert abs(row.error(name, lambda o: o.amplitude("x"))) < 1e-7
    assert circle.methods["df1"].fold == pytest.approx(-0.25, rel=1e-9)


def test_default_methods_that_cannot_do_a_system_are_left_out_with_a_sentence():
    """The first describing function of van der Pol's oscillator has amplitude 2 and omega 1 at every mu (closed form).

    The second needs elements, of which this system has none.
    """
    found = compare(hb.load_problem("van_der_pol").van_der_pol(), values=(1.0,), interval=(-1.0, 2.0), truth="mhb31")
    assert found.approximations == ("df1", "mhb3", "mhb15") and "df2 is left out" in " ".join(found.left_out)
    (row,) = found.rows
    assert row.orbits["df1"].amplitude("x") == pytest.approx(2.0, rel=1e-9)
    assert row.orbits["df1"].omega == pytest.approx(1.0, rel=1e-9)
    assert "df2 is left out" in repr(found)


def test_both_cycles_are_compared_part_by_part(found):
    assert [(row.value, row.part) for row in found.rows] == [(90.0, 0), (90.0, 1), (127.81, 1), (184.46, 1)]


def test_more_harmonics_are_better(found):
    for row in found.rows[1:]:
        errors = [abs(row.error(name, lambda o: o.amplitude("q1"))) for name in ("df1", "mhb3", "mhb15")]
        assert errors[0] > errors[1] > errors[2]


def test_folds_by_method(found):
    """PUBLISHED: independently computed folds, half a unit of the last digit."""
    for name, fold in (("df1", 87.754), ("mhb3", 88.427), ("mhb15", 88.763)):
        assert found.methods[name].fold == pytest.approx(fold, abs=6e-4)


def test_tables_and_sentences_come_from_the_numbers(found):
    errors, methods = table_of_errors(found), table_of_methods(found)
    assert len(errors.rows) == 4 and [row[0] for row in methods.rows] == ["df1", "mhb3", "mhb15", "mhb41"]
    said = {text.split(":")[0]: text for text in verdicts(found)}
    assert "within 1 % in frequency and amplitude at 1 of 4" in said["df1"] and "-1.1 %" in said["df1"]
    assert "4 of 4" in said["mhb15"]


@pytest.fixture(scope="module")
def exact(bogie):
    values = (88.7642, 88.768, 90.0, 127.81, 190.0)
    return compare(bogie, ("mhb5", "Mhb31"), values, parameter="V", interval=(60.0, 190.0), truth="exact")


class TestClosedForm:
    """Cycles without harmonics that are left out, as the truth and beside others."""

    def test_every_cycle_of_both_parts_is_found(self, exact):
        both = [(V, part) for V in (88.7642, 88.768, 90.0) for part in (0, 1)]
        assert [(row.value, row.part) for row in exact.rows] == [*both, (127.81, 1), (190.0, 1)]
        assert exact.methods["exact"].fold == pytest.approx(88.7641131943, abs=5e-11)
        for row in exact.rows:
            assert row.truth.parameters["V"] == pytest.approx(row.value, rel=1e-13)

    def test_harmonics_tend_to_it(self, exact):
        coarse, fine = (
            max(abs(row.error(name, quantity)) for row in exact.rows[4:] for quantity in exact.quantities().values())
            for name in ("mhb5", "mhb31")
        )
        assert fine < 5e-3 and fine < 0.01 * coarse

    def test_its_branch_is_plain_data(self, exact, tmp_path):
        branch = exact.methods["exact"].branch
        assert [s.kind for s in branch.special] == ["hopf", "grazing", "grazing", "fold"]
        branch.save(tmp_path / "exact.nc")
        again = hb.Branch.load(tmp_path / "exact.nc")
        assert again.values == pytest.approx(branch.values) and again.folds()[0].status == branch.folds()[0].status
        stable = [o.stability.verdict for o in branch.orbits]
        assert stable[2] == "unstable" and stable[-1] == "stable"

    def test_beside_the_fold_two_cycles_are_told_apart(self, bogie, exact):
        """They part with the root of the distance to the fold."""
        (hopf,) = hb.hopf_points(bogie, "V", (60.0, 190.0))
        walk = exact_walk(bogie, hopf, (60.0, 190.0))
        fold, apart = walk.marked("fold")[0].value, []
        for distance in (1e-8, 4e-8, 16e-8):
            cycles = dict(exact_crossings(walk, fold + distance))
            assert set(cycles) == {0, 1}
            apart.append(cycles[1].omega - cycles[0].omega)
        assert np.array(apart[1:]) / apart[:-1] == pytest.approx(2.0, rel=1e-3)
        assert not list(exact_crossings(walk, fold - 1e-8))

    def test_a_smooth_system_has_no_closed_form(self):
        with pytest.raises(hb.ModelError, match="nothing that switches"):
            compare(hb.load_problem("bautin").bautin(), ("exact",), (-0.2,), interval=(-0.3, 0.2), truth="mhb5")


@pytest.mark.parametrize("name", ["df3", "mhbx", "mhb0", "shooting", ""])
def test_unknown_methods(name):
    with pytest.raises(hb.ModelError, match="write df1 or df2"):
        method_named(name)


def test_no_hopf_point(bogie):
    with pytest.raises(hb.ModelError, match="no Hopf point"):
        compare(bogie, ("df1",), parameter="V", interval=(20.0, 60.0))


class TestYang:
    def _column(self, report, table, header):
        found = next(t for t in report.tables if t.name == table)
        place = next(i for i, c in enumerate(found.columns) if c.startswith(header))
        return {row[0]: row[place] for row in found.rows}

    def test_the_papers_method_meets_the_printed_states(self, report):
        """PUBLISHED: V within 0.2 m/s, omega within 0.03 rad/s at the printed a1, but for state 6."""
        V, omega = (
            self._column(report, "speeds", "V paper, NLP"),
            self._column(report, "frequencies", "omega paper, NLP"),
        )
        for s in hb.load_problem("yang1995").TABLE_1[1:]:
            assert omega[s.state] == pytest.approx(s.omega_el, abs=0.03)
            if s.state != 6:
                assert V[s.state] == pytest.approx(s.V, abs=0.2)
        assert V[6] == pytest.approx(94.22, abs=0.05)

    def test_search_program_and_describing_function_agree(self, report):
        columns = [self._column(report, "speeds", f"V {m}") for m in ("paper, search", "paper, NLP", "df1")]
        for state in columns[0]:
            np.testing.assert_allclose([c[state] for c in columns], columns[0][state], rtol=1e-6)

    def test_integration_confirms_the_truth(self, report):
        for quantity in ("omega RK4", "a1 RK4", "a2 RK4"):
            errors = self._column(report, "errors", quantity)
            assert max(abs(e) for e in errors.values() if e is not None) < 0.02

    def test_misprint_is_reported_with_its_evidence(self, report):
        (note,) = (n for n in report.notes if n.startswith("State 6"))
        assert "94.2" in note and "misprint" in note

    def test_heuristic_and_floquet_verdicts_agree(self, report):
        heuristic, judge = self._column(report, "stability", "heuristic"), self._column(report, "stability", "Floquet")
        for state in range(2, 15):
            assert heuristic[state] == judge[state]

    def test_figures_of_the_paper(self, bogie):
        paper = hb.load_problem("yang1995").paper(bogie, SILENT)
        assert list(paper.figures) == [f"figure_{n}" for n in range(2, 7)]
        assert "rest" in paper.notes[0] and "10.0" in paper.notes[1]

    def test_identified_creep_coefficients(self, bogie):
        """Free: f11 10.34 +- 0.02 MN, f22 9.59 +- 0.02 MN, f23 22 +- 2 kN m; Kalker: G a b 2.277 MN within 0.2 %."""
        fitted = hb.load_problem("yang1995").identification(bogie, SILENT)
        values = {row[1]: row[3] for row in fitted.tables[0].rows}
        assert values["f11"] == pytest.approx(10.34e6, abs=0.02e6)
        assert values["f22"] == pytest.approx(9.59e6, abs=0.02e6)
        assert values["f23"] == pytest.approx(22e3, abs=2e3)
        assert values["Gab"] == pytest.approx(2.277e6, rel=2e-3)

    def test_the_data_do_not_support_a_gravity_stiffness(self):
        """Its fitted share is nearer to 0 than to 1."""
        yang = hb.load_problem("yang1995")
        fitted = yang.identification(yang.bogie(gravity=True), SILENT, free=("f11", "f22", "f23", "kg"))
        share = next(row[3] for row in fitted.tables[0].rows if row[1] == "kg")
        assert abs(share) < abs(share - 1)

    def test_unknown_theory(self, bogie):
        with pytest.raises(hb.ModelError, match="unknown theory"):
            hb.load_problem("yang1995").identification(bogie, SILENT, theory="Johnson")
