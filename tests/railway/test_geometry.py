"""Profiles, rigid contact geometry and equivalent conicity against published numbers and closed forms."""

import csv
from pathlib import Path

import numpy as np
import pytest

from hbbogie import ModelError
from hbbogie.model import DeadBand
from hbbogie.railway import (
    Profile,
    contact_geometry,
    equivalent_conicity,
    read_rail,
    read_wheel,
    s1002,
    s1002_height,
    sampling_error,
    uic60,
)

HERE = Path(__file__).parent


def rows(name):
    with open(HERE / name, encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def column(table, name, case):
    return np.array([float(row[name]) for row in table if row["case"] == case])


# --- profiles ---------------------------------------------------------------------------------


JOINTS = (32.15796, -26.0, -35.0, -38.426669071, -39.764473993, -49.662510381, -62.764705882)


def test_sections_of_s1002_meet():
    """The printed coefficients join to 0.12 micrometres; the tip of the flange is 28 mm down at -55 mm."""
    for joint in JOINTS:
        assert np.diff(s1002_height([joint - 1e-9, joint + 1e-9])) == pytest.approx([0.0], abs=1.2e-4)
    assert s1002_height([-55.0, 0.0, 60.0]) == pytest.approx([28.0, 0.0, 1.36432364 - 60 * 0.066666667], abs=1e-12)
    assert np.isnan(s1002_height([-71.0, 61.0])).all()


# Points of the S1002 file of the Manchester contact benchmark (CONTACT, examples, Apache-2.0), mirrored
def test_s1002_is_the_profile_of_the_benchmark():
    assert s1002_height([-69.612628, -66.900 - 1.024e-3, -59.540957]) == pytest.approx(
        [13.485642, 20.356896, 27.107642], abs=2e-6
    )


def test_spline_of_s1002_follows_its_formula():
    y = np.linspace(-69.0, 59.9, 4001)
    error = np.abs(s1002().height(y) - s1002_height(y))
    away = np.abs(y[:, None] - JOINTS).min(axis=1) > 0.5
    assert error.max() < 1.5e-4 and error[away].max() < 1e-6


def write(path, y, z, line="{:.6f} {:.6f}", before="", after=""):
    path.write_text(before + "\n".join(line.format(a, b) for a, b in zip(y, z, strict=True)) + "\n" + after, "utf-8")
    return path


POINTS = np.linspace(-68.0, 58.0, 253)


@pytest.mark.parametrize(
    ("line", "before", "after"),
    [
        ("{:.6f} {:.6f}", "", ""),
        ("{:.6f},{:.6f}", "# a comment, with 2 numbers 3\ny_mm,z_mm\n", ""),
        ("{:.6f}, {:.6f}", "! comment\n\n", ""),
        ("  {:.6f}\t{:.6f}  ", "header\npoint.begin\n", "point.end\nspline.end\n"),
        ("{:.6f};{:.6f};", "y; z\n", ""),
        ("{:.6f} {:.6f}  # right, 1", "\ufeff", ""),  # the mark of the byte order, and comments behind the numbers
    ],
)
@pytest.mark.parametrize("turned", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_wheel_is_read_in_any_format_and_orientation(tmp_path, line, before, after, turned):
    path = write(tmp_path / "worn.txt", turned[0] * POINTS, turned[1] * (s1002_height(POINTS) + 5), line, before, after)
    wheel = read_wheel(path)
    assert wheel.name == "worn"
    np.testing.assert_allclose(wheel.y, POINTS, atol=1e-6)
    np.testing.assert_allclose(wheel.z, s1002_height(POINTS), atol=2e-6)


@pytest.mark.parametrize("line", ["{};{}", "{} {}", "{}\t{}"])
def test_decimal_commas(tmp_path, line):
    path = write(tmp_path / "wheel.txt", POINTS, s1002_height(POINTS), line.replace("{}", "{:.4f}"))
    path.write_text(path.read_text("utf-8").replace(".", ","), "utf-8")
    np.testing.assert_allclose(read_wheel(tmp_path / "wheel.txt").z, s1002_height(POINTS), atol=1e-4)


def test_rail_is_read_in_any_orientation(tmp_path):
    rail = uic60()
    kept = slice(40, -40)
    for i, (across, up) in enumerate([(1, 1), (-1, 1), (1, -1), (-1, -1)]):
        path = write(tmp_path / f"{i}.dat", across * rail.y[kept], up * rail.z[kept])
        read = read_rail(path, mirrored=across < 0)
        np.testing.assert_allclose(read.y, rail.y[kept], atol=1e-6)
        np.testing.assert_allclose(read.z, rail.z[kept], atol=1e-6)


def test_inclination_of_a_rail(tmp_path):
    """Drawn upright and turned by 1:40 it is the inclined one; contact at 1:20 by a script of its own.

    Inclined by 1:20 the gauge face of UIC60 stands upright: many points lie one above the other.
    """
    rail, turn = uic60(), np.arctan(1 / 40)
    y, z = rail.y * np.cos(turn) - rail.z * np.sin(turn), rail.z * np.cos(turn) + rail.y * np.sin(turn)
    path = write(tmp_path / "drawn.txt", y, z, "{:.9f} {:.9f}")
    shift = np.array([1.0, 3.0, 6.0])
    drawn, inclined = (
        contact_geometry(s1002(), of, shift).radius_difference for of in (read_rail(path, inclination=1 / 40), rail)
    )
    assert drawn == pytest.approx(inclined, abs=2e-4)
    upright = contact_geometry(s1002(), uic60(1 / 20), [0.5, 1.0, 3.0, 5.0, 5.5, 6.0])
    expected = [0.0089708, 0.0180314, 0.0570159, 0.1053662, 0.1202495, 4.5135465]
    assert upright.radius_difference == pytest.approx(expected, abs=1e-3)
    with pytest.raises(ModelError, match=r"rail inclination: got 20; give a slope of at most 0\.2"):
        uic60(20)


def test_upright_faces_do_not_disturb_the_profile():
    """Points one above the other, to rounding, beside a parabola that a cubic spline meets exactly."""
    y = np.linspace(-35.0, 35.0, 141)
    face = np.linspace(30.0, 0.003 * 35**2, 40, endpoint=False)
    rising = np.append(-35.0 - 1e-8 * np.arange(40, 0, -1), y)
    rail = Profile("upright", rising, np.append(face, 0.003 * y**2))
    at = np.linspace(-34.99, 35.0, 1001)
    np.testing.assert_allclose(rail.height(at), 0.003 * at**2, atol=1e-9)
    np.testing.assert_allclose(rail.slope(at), 0.006 * at, atol=1e-8)


def test_what_is_under_an_overhang_is_left_out(tmp_path):
    """The web below the head of a rail, whose contour turns back."""
    rail = uic60()
    y = np.concatenate([[-20.0, -30.0, -40.0], rail.y[40:-40], [10.0, 5.0]])
    z = np.concatenate([[60.0, 55.0, 50.0], rail.z[40:-40], [50.0, 60.0]])
    read = read_rail(write(tmp_path / "rail.txt", y, z))
    np.testing.assert_allclose(read.y, rail.y[40:-40], atol=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 2\n" * 3, "3 lines of two numbers; give at least 10 points"),
        ("1 2 3\n" * 12, r"line 1, '1 2 3', has 3 numbers; give one block of two columns"),
        ("1 2\n" * 12 + "end\n3 4\n", "line 14, '3 4', stands after the text of line 13"),
        ("\n".join(f"{i} {0.1 * i}" for i in range(-9, 9)), "no point is more than 10 mm above or below"),
        ("\n".join(f"{i / 1e3} {i * i / 4e6}" for i in range(-60, 60)), "in millimetres"),
        ("\n".join(f"{(37 * i) % 120 - 60} {((37 * i) % 120 - 60) / 4}" for i in range(120)), "in their order along"),
        ("1 2\n" * 12 + "3 nan\n", "line 13, '3 nan', is no finite point"),
        (
            "\n".join(f"{i * i / 120} {i}" for i in range(-60, 60)),
            "30 mm wide and 119 mm high; give the lateral position",
        ),
        ("\n".join(f"{i} {i}" for i in range(5, 50)), "shift it so that the rolling circle is at y = 0"),
    ],
)
def test_files_that_are_refused(tmp_path, text, words):
    (tmp_path / "bad.txt").write_text(text, "utf-8")
    with pytest.raises(ModelError, match=words):
        read_wheel(tmp_path / "bad.txt")


def test_missing_file_and_flat_rail(tmp_path):
    with pytest.raises(ModelError, match=r"cannot read the profile .*none\.txt.*: No such file"):
        read_rail(tmp_path / "none.txt")
    with pytest.raises(ModelError, match="give a rail head with its sides"):
        read_rail(write(tmp_path / "flat.txt", np.arange(-30, 31), 0.003 * np.arange(-30, 31) ** 2))
    with pytest.raises(ModelError, match="y must increase"):
        Profile("profile", np.zeros(20), np.zeros(20))


# --- contact geometry -------------------------------------------------------------------------

# S1002 on UIC60 1:40, gauge 1435, back to back 1360, r0 460 mm, rigid, by an independent script (4 to 7 decimals):
# shift, radius difference, angles right and left, contact points on the wheels right and left, roll
RIGID = np.array(
    [
        [0.0, 0.0, 0.0242829, 0.0242829, 3.2546902, 3.2546902, 0.0],
        [1.0, 0.6365614, 0.0710216, 0.0167221, -9.3545894, 6.5473064, -5.41e-05],
        [2.0, 0.8044841, 0.0805473, 0.0128588, -11.1439295, 8.7347395, -0.0001162],
        [3.0, 0.9939212, 0.0921992, 0.0105752, -13.1037728, 10.4507933, -0.0001837],
        [4.0, 1.2346226, 0.1076601, 0.0092285, -15.3694462, 11.8896567, -0.0002595],
        [5.0, 3.6934346, 0.3004621, 0.0084903, -28.6141213, 13.1617034, -0.0003695],
        [6.0, 4.6772425, 0.4234939, 0.008088, -31.2397212, 14.4118696, -0.0006509],
        [7.0, 18.8162676, 1.0715213, 0.0061429, -41.0614779, 18.6588482, -0.0064108],
        [8.0, 20.8540628, 0.9544438, 0.007396, -42.3392412, 20.3309447, -0.0086626],
        [10.0, 23.2805689, 0.8006068, 0.0110325, -44.3617187, 22.4954406, -0.0113494],
    ]
)
# the same with a yaw of 2.4 mrad per mm, and what elastic bodies do by CONTACT (Manchester benchmark)
YAWED = np.array(
    [
        [1.0, 0.6364, 0.604],
        [2.0, 0.8036, 0.797],
        [3.0, 0.991, 0.989],
        [4.0, 1.2273, 1.230],
        [5.0, 3.6758, 3.521],
        [6.0, 4.6081, 4.608],
        [6.5, 17.3054, 16.8],
    ]
)


def test_rigid_contact_of_s1002_on_uic60():
    y, difference, right, left, on_right, on_left, roll = RIGID.T
    found = contact_geometry(s1002(), uic60(), y)
    assert np.abs(found.radius_difference - difference).max() < 1e-3
    assert np.abs(found.wheel_right - on_right).max() < 1e-3
    assert np.abs(found.wheel_left - on_left).max() < 1e-3
    assert np.abs(found.angle_right - right).max() < 1e-5
    assert np.abs(found.angle_left - left).max() < 1e-5
    assert np.abs(found.roll - roll).max() < 1e-6


def test_yawed_contact():
    y, rigid, elastic = YAWED.T
    found = contact_geometry(s1002(), uic60(), y, yaw=2.4e-3 * y)
    assert np.abs(found.radius_difference - rigid).max() < 1e-3
    # elastic patches move the contact where the profiles are nearly conformal: seen beside, not met
    assert np.abs(found.radius_difference / elastic - 1).max() < 0.06


def test_mirrored_shift_mirrors_everything():
    y = np.array([0.7, 3.3, 5.9])
    one, other = contact_geometry(s1002(), uic60(), y), contact_geometry(s1002(), uic60(), -y)
    for name in ("radius", "angle", "wheel", "rail"):
        right, left = getattr(one, f"{name}_right"), getattr(other, f"{name}_left")
        assert right == pytest.approx(left, abs=1e-4)
    assert one.roll == pytest.approx(-other.roll, abs=1e-8)


def test_cones_on_round_rails():
    """Wheels of slope g on rails of radius R touch R sin(g) inside the top, and the roll adds to the difference.

    With the contact points l from the middle the roll is -g y/(l - g r0). It moves the contact by (R + r0) times
    itself, and the difference is 2 g y (1 + g (R + r0)/(l - g r0)), up to terms of third order.
    """
    g, R = 0.05, 300.0
    S = np.concatenate([np.linspace(-70, -40, 31), np.linspace(-39, 60, 100)])
    wheel = Profile("cone", S, np.where(S < -38.5, 40.0, -g * S))
    Y = np.linspace(-36, 36, 289)
    sides = np.maximum(np.abs(Y) - 35, 0) * 30
    rail = Profile("round", Y, R - np.sqrt(R**2 - Y**2) + sides)
    y = np.array([-2.0, 0.0, 1.0, 3.0])
    found = contact_geometry(wheel, rail, y, back_to_back=1360.0)
    l = 750.0 - R * g
    assert found.radius_difference == pytest.approx(2 * g * y * (1 + g * (R + 460) / (l - g * 460)), rel=1e-3, abs=1e-5)
    assert found.angle_right + found.roll == pytest.approx(np.full(4, np.arctan(g)), abs=1e-6)
    assert found.rail_right == pytest.approx(-R * np.sin(found.angle_right), abs=2e-3)


WORN = Profile("worn", POINTS, s1002_height(POINTS) - 0.2 * np.exp(-((POINTS - 2) ** 2) / 200))


def test_sides_that_differ_change_places_in_the_mirror():
    """IDENTITY: the right side of one wheelset at y is the left side of the mirrored one at -y."""
    y = np.array([-4.1, 0.3, 2.7])
    one = contact_geometry(s1002(), uic60(), y, left_wheel=WORN, radius=459.8, left_radius=460.1)
    other = contact_geometry(WORN, uic60(), -y, left_wheel=s1002(), radius=460.1, left_radius=459.8)
    assert one.wheel == "S1002/worn" and other.wheel == "worn/S1002" and one.rail == "UIC60"
    for name in ("radius", "angle", "wheel", "rail"):
        for mine, yours in (("right", "left"), ("left", "right")):
            here, there = getattr(one, f"{name}_{mine}"), getattr(other, f"{name}_{yours}")
            assert here == pytest.approx(there, abs=1e-6)
    assert one.radius_difference == pytest.approx(-other.radius_difference, abs=1e-6)
    assert one.roll == pytest.approx(-other.roll, abs=1e-9)


def test_equal_sides_given_twice_are_one_pair():
    y = np.array([-3.0, 0.0, 1.7])
    one, other = (
        contact_geometry(s1002(), uic60(), y, **left) for left in ({}, {"left_wheel": s1002(), "left_radius": 460.0})
    )
    np.testing.assert_allclose(one.radius_difference, other.radius_difference, atol=1e-12)
    assert one.wheel == other.wheel == "S1002"


def test_a_smaller_left_wheel_adds_to_the_radius_difference():
    """On cones the difference of the radii counts, with the roll that it makes as in `test_cones_on_round_rails`.

    The head of a UIC60 rail has the radius 300 mm where it touches.
    """
    S = np.concatenate([np.linspace(-70, -40, 31), np.linspace(-39, 60, 100)])
    g = 0.05
    wheel = Profile("cone", S, np.where(S < -38.5, 40.0, -g * S))
    found = contact_geometry(wheel, uic60(), [1.0], left_radius=459.0)
    same = contact_geometry(wheel, uic60(), [1.0])
    share = 1 + g * (300 + 460) / (750 - 300 * g - 460 * g)
    assert found.radius_difference - same.radius_difference == pytest.approx(share, abs=2e-3)
    with pytest.raises(ModelError, match="left_radius: got -1"):
        contact_geometry(wheel, uic60(), [0.0], left_radius=-1.0)


def test_gaps_are_closed_nowhere_else():
    """No point of either wheel lies deeper in its rail than the contact point."""
    wheel, rail = s1002(), uic60()
    found = contact_geometry(wheel, rail, [4.3])
    S = np.linspace(-60, 50, 20001)
    offset = 717.5 + 43.0328785
    for side, at in ((1, found.wheel_right[0]), (-1, found.wheel_left[0])):
        roll, shift = side * found.roll[0], side * 4.3

        def gap(S, roll=roll, shift=shift):
            r = 460 + wheel.height(S)
            Y = (750 + S) * np.cos(roll) - r * np.sin(roll) + shift - offset
            return rail.height(Y) - r * np.cos(roll) - (750 + S) * np.sin(roll) + 460

        assert np.nanmin(gap(S)) > gap(at) - 1e-9
        assert gap(at) == pytest.approx(found.lowering[0], abs=1e-3)


def test_contact_that_is_refused():
    wheel, rail = s1002(), uic60()
    with pytest.raises(ModelError, match=r"at a lateral shift of 100 mm"):
        contact_geometry(wheel, rail, [0.0, 100.0])
    short = Profile("short", rail.y[200:], rail.z[200:])
    with pytest.raises(ModelError, match="the gauge is measured 14 mm below; give a longer profile, or mirror"):
        contact_geometry(wheel, short, [0.0])
    narrow = Profile("narrow", wheel.y[wheel.y < 2], wheel.z[wheel.y < 2])
    with pytest.raises(ModelError, match="narrow touches UIC60 where one of the profiles ends"):
        contact_geometry(narrow, rail, [0.0])
    with pytest.raises(ModelError, match=r"gauge: got -1"):
        contact_geometry(wheel, rail, [0.0], gauge=-1)


# --- conicity ---------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["1", "2", "3"])
def test_reference_cases_of_en15302(case):
    """All amplitudes whose travel stays inside the table, to the rounding of the reference and of its table."""
    table, reference = rows("en15302_delta_r.csv"), rows("en15302_equivalent_conicity.csv")
    A, expected = column(reference, "amplitude_mm", case), column(reference, "tan_gamma_e", case)
    inside = A < 6.75
    assert inside.sum() == 58
    found = equivalent_conicity(column(table, "y_mm", case), column(table, "delta_r_mm", case), A[inside])
    assert np.abs(found.equivalent - expected[inside]).max() < 1e-3
    with pytest.raises(ModelError, match=r"amplitude 6\.9 mm: the travel leaves the table of shifts, -6\.8 to 6\.8 mm"):
        equivalent_conicity(column(table, "y_mm", case), column(table, "delta_r_mm", case), A)


def test_conicity_of_s1002_on_uic60():
    """Against an independent script, on a grid of 0.1 mm."""
    y = np.linspace(-7, 7, 141)
    found = equivalent_conicity(y, contact_geometry(s1002(), uic60(), y).radius_difference, [2.0, 3.0, 6.0])
    assert found.equivalent == pytest.approx([0.2291050498, 0.1835417203, 0.3047022771], abs=2e-6)


def test_cone_has_its_conicity_by_every_definition():
    y = np.linspace(-9, 7, 33)
    found = equivalent_conicity(y, 2 * 0.15 * (y - 0.5), [1.0, 3.0, 6.0])  # an axle that runs 0.5 mm off the middle
    for name in ("equivalent", "least_squares", "harmonic"):
        assert getattr(found, name) == pytest.approx(np.full(3, 0.15), rel=1e-9)
    assert found.centre == pytest.approx(np.full(3, 0.5), abs=1e-9)


def test_small_amplitudes_see_the_slope_in_the_middle():
    """However small: the potentials of the table's ends are much larger than those of the travel."""
    y = np.linspace(-8, 8, 161)
    found = equivalent_conicity(y, 0.4 * y + np.where(np.abs(y) > 6, 20 * np.sign(y), 0), [1e-4, 1e-3, 1e-2])
    assert found.equivalent == pytest.approx(np.full(3, 0.2), rel=1e-6)


def test_linearisations_of_a_dead_band_are_in_closed_form():
    """Describing function of the gap, and the best line by quadrature."""
    gap, k, A = 2.0, 0.8, np.array([1.0, 2.5, 5.0, 9.0])
    y = np.linspace(-10, 10, 201)
    found = equivalent_conicity(y, k * (np.maximum(y - gap, 0) + np.minimum(y + gap, 0)), A)
    assert found.harmonic == pytest.approx([float(DeadBand(k, gap).describing(a)) / 2 for a in A], rel=1e-10)
    u = np.linspace(-1, 1, 200001)
    lines = [np.polyfit(a * u, k * (np.maximum(a * u - gap, 0) + np.minimum(a * u + gap, 0)), 1)[0] / 2 for a in A]
    assert found.least_squares == pytest.approx(lines, rel=1e-4, abs=1e-12)
    assert found.equivalent[0] == 0.0


def test_wavelength_of_a_parabolic_difference():
    """difference = k y^3: the period of the quartic potential is a complete elliptic integral (lemniscate)."""
    y = np.linspace(-5, 5, 2001)
    A, k = np.array([2.0, 4.0]), 0.01
    found = equivalent_conicity(y, k * y**3, A)
    lemniscate = 2.6220575542921198
    exact = (np.pi / (np.sqrt(2) * lemniscate * np.sqrt(2 / k) / A)) ** 2
    assert found.equivalent == pytest.approx(exact, rel=1e-4)


def test_no_conicity_where_the_wheelset_does_not_swing():
    found = equivalent_conicity([-5, -1, 1, 5], [-1, 0.5, -0.5, 1], [1.0, 4.5])
    assert np.isnan(found.equivalent[0]) and found.equivalent[1] > 0


def test_tables_that_are_refused():
    with pytest.raises(ModelError, match="falls from 1 to -1 mm"):
        equivalent_conicity([-5, 5], [1, -1], [1.0])
    with pytest.raises(ModelError, match="with increasing shifts"):
        equivalent_conicity([5, -5], [1, -1], [1.0])
    with pytest.raises(ModelError, match="amplitude: got"):
        equivalent_conicity([-5, 5], [-1, 1], [0.0])


# --- distance of the points -------------------------------------------------------------------


@pytest.mark.parametrize("step", [1.0, 3.0, 5.0])
def test_error_of_the_sampling_is_bounded_by_leaving_out_every_other_point(step):
    """Against the profile's formula, points at two places each; flange contact is where the error is largest."""
    shift, amplitude = np.linspace(-8.0, 8.0, 161), [1.0, 3.0, 5.0, 6.0]
    true = equivalent_conicity(shift, contact_geometry(s1002(), uic60(), shift).radius_difference, amplitude)
    for offset in (0.0, 0.37):
        y = np.arange(-68.0 + offset * step, 60.0, step)
        wheel = Profile("sampled", y, s1002_height(y))
        found = equivalent_conicity(shift, contact_geometry(wheel, uic60(), shift).radius_difference, amplitude)
        error, bound = np.abs(found.equivalent - true.equivalent), sampling_error(wheel, uic60(), shift, amplitude)
        assert (error <= bound["wheel"] + 1e-6).all()
        assert (bound["wheel"].max() > 0.03) == (step > 1.0)
        assert step > 1.0 or bound["rail"].max() < 0.03


def test_too_few_points_to_leave_any_out():
    y = np.array([-60.0, -45.0, -35.0, -30.0, -26.0, -20.0, -10.0, 0.0, 10.0, 20.0, 40.0, 58.0])
    wheel = Profile("few", y, s1002_height(y))
    assert sampling_error(wheel, uic60(), np.linspace(-3.0, 3.0, 31), [1.0])["wheel"] == [np.inf]
