import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import to_hex

from hbbogie import plot
from hbbogie.errors import ModelError
from hbbogie.plot import appearance, decimated, followed, pieces
from hbbogie.results import Branch, Naming, Orbit, SpecialPoint, Stability, Trajectory

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


def make_orbit(V=90.0, peak=0.01, verdict=None, H=3, multipliers=(1.0, 0.5)):
    c = np.zeros((2 * H + 1, 3))
    c[1] = peak, 0.05 * peak, 0.9 * peak
    if H >= 3:
        c[5] = 1e-3 * c[1]
    stability = None
    if verdict:
        outside = int(sum(abs(m) > 1 for m in multipliers))
        stability = Stability(verdict, np.array(multipliers, complex), 0.0, outside, "made up")
    units = ("m", "rad", "m")
    return Orbit("bogie", ("q1", "q2", "q3"), units, c, 27.0 + V / 50, {"V": V}, stability=stability)


def fold_branch(verdicts=("unstable",) * 4 + ("stable",) * 4):
    peak = 0.0098 + 1e-4 * np.array([-7, -5, -3, -1, 1, 3, 5, 7])
    V = 88.0 + (peak - 0.0098) ** 2 * 1e7
    orbits = [make_orbit(v, a, s) for v, a, s in zip(V, peak, verdicts, strict=True)]
    fold = SpecialPoint("fold", "V", 88.0, (87.99, 88.0), make_orbit(88.0, 0.0098), "located")
    return Branch(tuple(orbits), "V", (fold,))


def curves(ax):
    """The curves of a branch figure: the lines with data that are no points."""
    return [s for s in ax.lines if len(s.get_xdata()) > 1 and s.get_linestyle() != "None"]


def pattern(line):
    return line.get_linestyle(), line._unscaled_dash_pattern[1]


def test_each_verdict_has_its_line():
    ax = plot.branch(fold_branch(("unstable",) * 3 + ("unknown",) * 2 + ("stable",) * 3))
    unstable, unknown, stable = curves(ax)
    assert stable.get_linestyle() == "-"
    assert pattern(unstable) == ("--", appearance.LINES["unstable"][1])
    assert pattern(unknown) == ("--", appearance.LINES["unknown"][1])
    assert [t.get_text() for t in ax.get_legend().get_texts()][:3] == ["stable", "unstable", "unknown"]


def test_segments_join_at_the_fold_between_them():
    unstable, stable = curves(plot.branch(fold_branch()))
    np.testing.assert_array_equal(unstable.get_xydata()[-1], stable.get_xydata()[0])
    np.testing.assert_allclose(stable.get_xydata()[0], [88.0, 9.8 * (1 + 1e-3)], rtol=3e-3)
    assert stable.get_xydata()[0][0] == 88.0


def test_segments_join_between_the_points_where_no_fold_is_near():
    verdicts = ("unstable",) * 6 + ("stable",) * 2
    branch = fold_branch(verdicts)
    unstable, stable = curves(plot.branch(branch))
    joint = unstable.get_xydata()[-1]
    np.testing.assert_array_equal(joint, stable.get_xydata()[0])
    assert branch.values[5] < joint[0] < branch.values[6]


def test_one_changed_point_and_a_branch_of_one_point_stay_visible():
    ax = plot.branch(fold_branch(("stable",) * 5 + ("unstable",) + ("stable",) * 2))
    assert [line.get_linestyle() for line in curves(ax)] == ["-", "--", "-"]
    ax = plot.branch(Branch((make_orbit(),), "V"))
    assert ax.lines[0].get_marker() == "o"


def circle_branch(count):
    """Cycles whose peak and parameter lie on a circle, so that there are two folds; no stability."""
    phi = np.linspace(0.2, 2 * np.pi - 0.2, count)
    return Branch(tuple(make_orbit(88.0 + np.cos(p), 0.01 + 0.001 * np.sin(p), H=1) for p in phi), "V")


def test_curves_are_smooth_between_the_points():
    """They pass through every point, and leave a circle by far less than chords do: by the third power of the step."""
    errors = []
    for count in (13, 25):
        branch = circle_branch(count)
        ((_, points),) = pieces(branch, lambda o: o.first_harmonic("q1"))
        away = np.hypot(points[:, 0] - 88.0, (points[:, 1] - 0.01) / 0.001) - 1
        errors.append(np.abs(away).max())
        assert all(
            np.abs(points - [o.parameters["V"], o.first_harmonic("q1")]).sum(axis=1).min() < 1e-9 for o in branch
        )
    chord = 1 - np.cos(np.pi / 12 * (1 - 0.2 / np.pi))
    assert errors[0] < 0.3 * chord and errors[1] < errors[0] / 5


def test_curves_bend_only_where_a_contact_begins():
    """A line that becomes a steeper one: without the contact the bend is rounded off, with it it is kept."""
    V = np.array([88.0, 88.5, 89.0, 89.5, 90.0, 90.5])
    peaks = 0.01 + 1e-3 * np.where(V < 89.25, V - 88, 1.25 + 5 * (V - 89.25))
    kink = SpecialPoint("grazing", "V", 89.25, (89.2, 89.3), make_orbit(89.25, 0.01125, H=1), "front begins to touch")
    orbits = tuple(make_orbit(v, a, H=1) for v, a in zip(V, peaks, strict=True))
    ((_, points),) = pieces(Branch(orbits, "V", (kink,)), lambda o: o.first_harmonic("q1"))
    exact = 0.01 + 1e-3 * np.where(points[:, 0] < 89.25, points[:, 0] - 88, 1.25 + 5 * (points[:, 0] - 89.25))
    np.testing.assert_allclose(points[:, 1], exact, rtol=1e-12)


def test_lengths_are_shown_in_millimetres_and_labels_carry_units():
    branch = fold_branch()
    ax = plot.branch(branch, "q3", quantity="first harmonic", parameter_label="speed V [m/s]")
    assert ax.get_ylabel() == "first harmonic of q3 [mm]"
    assert ax.get_xlabel() == "speed V [m/s]"
    assert curves(ax)[0].get_ydata()[0] == pytest.approx(1e3 * branch.first_harmonic("q3")[0], rel=1e-12)
    trajectory = Trajectory("bogie", ("q1",), ("m",), np.arange(3.0), np.ones((3, 1)), np.zeros((3, 1)))
    labels = {
        "[mrad]": plot.branch(branch, "q2"),
        "[rad/s]": plot.frequency(branch),
        "[mm]": plot.orbit(branch.orbits[0]),
        "[mm]; q2 [mrad]": plot.waveform(branch.orbits[0], ["q1", "q3", "q2"]),
        "of q1 [mm]": plot.spectrum(branch.orbits[0]),
        "q1 [m]": plot.time_history(trajectory),
    }
    for unit, ax in labels.items():
        assert unit in ax.get_ylabel() or unit in ax.get_xlabel(), unit
        if ax.get_xlabel().startswith("time"):
            assert ax.get_xlabel() == "time t [s]"


@pytest.mark.parametrize(
    ("unit", "size", "expected"),
    [
        ("m", 0.03, (1e3, "mm")),
        ("m", 2.0, (1.0, "m")),
        ("m", 3e-5, (1e6, "µm")),
        ("rad", 0.5, (1.0, "rad")),
        ("rad", 0.02, (1e3, "mrad")),
        ("m/s", 0.3, (1e3, "mm/s")),
        ("N", 0.001, (1.0, "N")),
        ("N m/rad", 2e4, (1e-3, "kN m/rad")),
        ("N2", 2e4, (1.0, "N2")),  # k(N2) is not (kN)2
        ("m", 0.0, (1.0, "m")),
    ],
)
def test_scale(unit, size, expected):
    assert appearance.scale(unit, [np.array([-size])]) == expected


def test_curves_drawn_later_keep_the_unit_of_the_axis():
    ax = plot.orbit(make_orbit(peak=0.01))
    plot.orbit(make_orbit(peak=3.0), ax=ax)
    assert ax.get_xlabel() == "q1 [mm]"
    assert ax.lines[1].get_xdata().max() == pytest.approx(3000, rel=2e-3)


def test_published_points_are_drawn_on_top_in_the_same_unit():
    published = [("Table 1", [90.0, 91.0], [0.0094, 0.0101], "^")]
    ax = plot.branch(fold_branch(), published=published)
    points = next(line for line in ax.lines if line.get_label() == "Table 1")
    np.testing.assert_allclose(points.get_ydata(), [9.4, 10.1])
    assert points.get_marker() == "^"
    assert points.get_zorder() > max(line.get_zorder() for line in ax.lines if line is not points)
    assert points.get_markerfacecolor() == "none"  # what is below stays visible


def test_special_points_are_marked():
    """A Hopf point at the level of the equilibrium, whatever the size of its mode."""
    rest = np.array([[0.002, 0.0, 0.0], [1.0, 0.1, 0.9], [0.0, 0.0, 0.0]])
    hopf = SpecialPoint("hopf", "V", 90.97, (90.9, 91.0), make_orbit(90.97).replace(coefficients=rest), "located")
    ax = plot.branch(fold_branch(), special=[hopf])
    marks = {line.get_label(): line.get_xydata()[0] for line in ax.lines if line.get_zorder() == 5}
    np.testing.assert_allclose(marks["Hopf point (V = 90.97)"], [90.97, 2.0])
    assert marks["fold (V = 88)"][0] == 88.0


def test_the_gap_of_a_contact_and_the_linear_cycles_below_it_are_drawn():
    naming = Naming({"V": "m/s", "y0": "m"}, {"y0": "clearance", "q1": "front, lateral"})
    at = {"parameters": {"V": 91.0, "y0": 0.0091}, "naming": naming}
    orbits = [make_orbit(91.0 - 0.1 * k, 0.0091 + 1e-4 * k, "unstable", H=1) for k in range(8)]
    orbits = [o.replace(parameters={**o.parameters, "y0": 0.0091}, naming=naming) for o in orbits]
    touch = SpecialPoint("grazing", "V", 91.0, (91.0, 91.0), orbits[0], "front begins to touch")
    hopf = SpecialPoint("hopf", "V", 91.0, (91.0, 91.0), make_orbit(91.0, 1.0, H=1).replace(**at), "located")
    ax = plot.branch(Branch(tuple(orbits), "V", (touch,)), special=[hopf])
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    assert set(lines["clearance y0"][:, 1]) == {9.1}
    np.testing.assert_allclose(lines["linear cycles"], [[91.0, 0.0], [91.0, 9.1]])
    assert ax.get_ylabel() == "peak of front, lateral q1 [mm]" and ax.get_xlabel() == "V [m/s]"
    assert "Hopf point (V = 91 m/s)" in lines


def test_linear_cycles_stand_once_in_the_legend_and_only_where_there_is_a_line():
    orbits = [make_orbit(91.0 - 0.1 * k, 0.0091 + 1e-4 * k, "unstable", H=1) for k in range(8)]
    hopf = SpecialPoint("hopf", "V", 91.0, (91.0, 91.0), make_orbit(91.0, 1.0, H=1), "located")
    ax = plot.branch([Branch(tuple(orbits), "V"), Branch(tuple(orbits[::-1]), "V")], special=[hopf])
    assert [line.get_label() for line in ax.lines].count("linear cycles") == 1
    grown = [make_orbit(91.0 + 0.1 * k, 1e-5 + 1e-3 * k, "stable", H=1) for k in range(8)]
    ax = plot.branch(Branch(tuple(grown), "V"), special=[hopf])
    assert "linear cycles" not in [line.get_label() for line in ax.lines]


def test_a_legend_names_what_is_within_the_axes_only():
    ax = plot.branch(fold_branch())
    ax.set_ylim(9.9, 11.0)  # above the fold
    appearance.legend(ax)
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["stable"]


def test_a_long_label_is_wrapped_and_keeps_its_unit():
    words = "displacement of the middle of the front wheelset from the middle of the track, to the left"
    orbit = make_orbit().replace(naming=Naming({"q1": "m"}, {"q1": words}))
    ax = plot.branch(Branch((orbit,), "V"))
    ax.figure.canvas.draw()
    assert ax.yaxis.label.get_window_extent().height <= 1.05 * ax.get_window_extent().height
    plot.branch(Branch((orbit,), "V"), ax=ax)
    assert " ".join(ax.get_ylabel().split()) == f"peak of {words} q1 [mm]"


def test_no_entry_of_a_legend_is_without_a_line():
    for ax in (plot.branch(fold_branch()), plot.frequency(fold_branch()), plot.branch(circle_branch(20))):
        drawn = {line.get_linestyle() for line in curves(ax)}
        names = {t.get_text() for t in ax.get_legend().get_texts()}
        assert ("stable" in names) == ("-" in drawn)
        assert ("unknown" in names) == any(pattern(c)[1] == appearance.LINES["unknown"][1] for c in curves(ax))


def test_one_colour_rule():
    """What is stable is blue and solid, unstable orange and dashed, unknown grey and dotted, in every figure."""
    orbits = [make_orbit(90.0, 0.01 * (k + 1), v) for k, v in enumerate(("unstable", "stable", "unknown"))]
    for draw in (plot.orbit, plot.spectrum, lambda o: plot.waveform(o, "q1")):
        for line, o in zip(draw(orbits).lines, orbits, strict=True):
            assert to_hex(line.get_color()) == appearance.SHADES[o.verdict].lower()
            assert pattern(line)[1] == (None if o.verdict == "stable" else appearance.LINES[o.verdict][1])
    for line in curves(plot.branch([fold_branch(), fold_branch()])):
        stable = line.get_linestyle() == "-"
        assert to_hex(line.get_color()) == appearance.SHADES["stable" if stable else "unstable"].lower()


def test_several_branches_have_their_own_colours():
    ax = plot.branch([fold_branch(), fold_branch(("stable",) * 8)], labels=["H = 15", "H = 1"])
    assert len({line.get_color() for line in curves(ax)}) == 2
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert texts[:4] == ["H = 15", "H = 1", "stable", "unstable"]


def test_frequency_shows_hertz_on_the_right():
    ax = plot.frequency(fold_branch())
    (right,) = ax.child_axes
    assert right.get_ylabel() == "frequency [Hz]"
    ax.figure.canvas.draw()
    np.testing.assert_allclose(right.get_ylim(), np.array(ax.get_ylim()) / (2 * np.pi))


def test_phase_portrait_is_the_orbit():
    o = make_orbit()
    (line,) = plot.orbit(o).lines
    q, v = o.q(0.0)[0, 0], o.v(0.0)[0, 0]
    np.testing.assert_allclose(line.get_xydata()[0], [1e3 * q, 1e3 * v], atol=1e-9)
    np.testing.assert_allclose(line.get_xydata()[0], line.get_xydata()[-1], atol=1e-9)
    assert plot.orbit(o, "q1", "q3").get_ylabel() == "q3 [mm]"


def test_spectrum_leaves_out_what_vanishes_and_its_reference_lies_above():
    ax = plot.spectrum(make_orbit(H=5), reference=True)
    line, reference = ax.lines
    assert line.get_xdata().tolist() == [1, 3]
    assert ax.get_yscale() == "log"
    h = reference.get_xdata()
    np.testing.assert_allclose(reference.get_ydata() * h**4.0, reference.get_ydata()[0])
    assert (reference.get_ydata()[0] / line.get_xdata() ** 4.0 >= line.get_ydata() * (1 - 1e-12)).all()
    assert set(ax.get_xticks()) == {1, 3, 5}  # no ticks at harmonics that an odd motion lacks


def test_the_trivial_multiplier_is_left_out_of_the_moduli():
    branch = Branch(
        tuple(make_orbit(v, multipliers=(1.0, m, 0.2), verdict="stable") for v, m in [(1, 0.6), (2, 1.3)]),
        "V",
    )
    ax = plot.multipliers_along(branch, count=2)
    largest = next(line for line in ax.lines if line.get_label() == "largest")
    np.testing.assert_allclose(largest.get_ydata(), [0.6, 1.3])
    assert ax.get_yscale() == "linear"
    far = branch.with_orbits([make_orbit(1.0, multipliers=(1.0, 1e4), verdict="unstable")])
    assert plot.multipliers_along(far).get_yscale() == "log"


def test_multipliers_are_followed_by_continuity():
    """Two that cross in modulus keep their curves; ranks would swap there."""
    first, second = np.linspace(0.9, 0.3, 9), np.linspace(0.2, 0.8, 9)
    found = followed([np.array(sorted((a, -b), key=abs), dtype=complex) for a, b in zip(first, second, strict=True)])
    columns = sorted(found.T.real.tolist())
    np.testing.assert_allclose(columns, [(-second).tolist(), first.tolist()], rtol=1e-12)


def test_multipliers_of_one_orbit_tell_inside_from_outside():
    ax = plot.multipliers(make_orbit(verdict="unstable", multipliers=(1.4, 1.0, 0.3j, -0.3j)))
    found = {line.get_label(): len(line.get_xdata()) for line in ax.lines if line.get_marker() == "o"}
    assert found == {"inside": 2, "outside": 1, "trivial": 1}


def test_legend_stands_above_the_data():
    ax = plot.branch(fold_branch(), published=[("a rather long label of a table", [90], [0.01], "o")] * 4)
    ax.figure.canvas.draw()
    assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1 - 1


def test_legends_are_small():
    """At most an eighth of the figure, also with published points, and special points beside one another."""
    published = [(f"table {k}", [90.0], [0.01], "o") for k in range(2)]
    for ax in (plot.branch(fold_branch(), published=published), plot.frequency(fold_branch(), published=published)):
        figure = ax.figure
        figure.canvas.draw()
        legend, whole = ax.get_legend().get_window_extent(), figure.bbox
        assert legend.width * legend.height < whole.width * whole.height / 8


@pytest.mark.parametrize(
    ("label", "value", "shown", "first"),
    [
        ("stiffness K1 [N/m]", 3e6, "stiffness K1 [MN/m]", "3"),
        ("load W [N]", 133e3, "load W [kN]", "133"),
        ("speed V [m/s]", 90.0, "speed V [m/s]", "90"),
        ("conicity lam [1]", 0.05, "conicity lam", "0.05"),
        ("clearance y0 [m]", 0.0091, "clearance y0 [mm]", "9.1"),
        ("mu", 1.5, "mu", "1.5"),
    ],
)
def test_axes_have_engineering_units(label, value, shown, first):
    _, ((ax,),) = plot.panels(1, 1)
    ax.set_xlim(0, value)
    appearance.engineering(ax.xaxis, label)
    assert ax.get_xlabel() == shown and ax.xaxis.get_major_formatter()(value) == first


def test_titles_tell_system_and_values():
    assert plot.orbit(make_orbit(verdict="stable")).figure._suptitle.get_text() == "bogie, V = 90, stable"
    assert plot.branch(fold_branch()).figure._suptitle.get_text() == "bogie"


def test_many_samples_are_thinned_without_losing_peaks():
    t = np.linspace(0.0, 100.0, 200_001)
    q = np.column_stack([np.sin(40 * t), np.cos(3 * t)])
    thin, shown = decimated(t, q)
    assert len(thin) <= 6000 and (np.diff(thin) > 0).all()
    np.testing.assert_allclose([shown.min(axis=0), shown.max(axis=0)], [[-1, -1], [1, 1]], atol=1e-3)
    assert decimated(t[:100], q[:100])[0] is not None and len(decimated(t[:100], q[:100])[0]) == 100


def test_pdf_holds_truetype_fonts(tmp_path):
    data = plot.save(plot.branch(fold_branch()), tmp_path / "branch.pdf").read_bytes()
    assert b"/Type3" not in data and b"CIDFontType2" in data


def test_wrong_arguments_are_refused():
    with pytest.raises(ModelError, match="Did you mean 'peak'"):
        plot.branch(fold_branch(), quantity="peaks")
    with pytest.raises(ModelError, match="q11"):
        plot.branch(fold_branch(), "q11")
    with pytest.raises(ModelError, match="nothing to draw"):
        plot.branch([])
    with pytest.raises(ModelError, match="nothing to draw"):
        plot.orbit([])
    with pytest.raises(ModelError, match="floquet"):
        plot.multipliers(make_orbit())


def test_an_equilibrium_is_a_point_and_a_level():
    rest = Orbit("bogie", ("q1",), ("m",), np.array([[0.002]]), 0.0, {"V": 90.0})
    assert plot.orbit(rest).lines[0].get_xydata().tolist() == [[2.0, 0.0]]
    assert set(plot.waveform(rest).lines[0].get_ydata()) == {2.0}


def test_figures_share_a_page(tmp_path):
    fig, axes = plt.subplots(2, 2, layout="constrained")
    branch = fold_branch()
    plot.branch(branch, ax=axes[0, 0])
    plot.frequency([branch, branch], ax=axes[0, 1])
    plot.orbit(branch.orbits[:3], ax=axes[1, 0])
    plot.multipliers(branch, ax=axes[1, 1])
    assert plot.save(fig, tmp_path / "page.png").stat().st_size > 10_000


def test_save_writes_png_and_closes(tmp_path):
    ax = plot.orbit(make_orbit())
    path = plot.save(ax, tmp_path / "orbit")
    assert path.name == "orbit.png" and path.read_bytes().startswith(b"\x89PNG")
    assert plt.get_fignums() == []
    with pytest.raises(ModelError, match="does not exist"):
        plot.save(plot.orbit(make_orbit()), tmp_path / "no" / "orbit.png")


def test_the_session_keeps_its_style():
    before = dict(matplotlib.rcParams)
    plot.branch(fold_branch())
    assert dict(matplotlib.rcParams) == before


def test_importing_the_package_does_not_import_matplotlib():
    code = "import sys, hbbogie; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
