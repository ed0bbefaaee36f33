"""Creep laws against published points, their own formulas written a second time, limits, slopes and symmetry."""

import casadi as ca
import numpy as np
import pytest

from hbbogie import Coordinate, ModelError, Parameter, System, find_cycles, hopf_points, verify
from hbbogie.railway import (
    ContactEllipse,
    LinearKalker,
    Polach,
    Polach2005,
    ShenHedrickElkins,
    VermeulenJohnson,
    hertz_ellipse,
    kalker_coefficients,
)

F11, F22, F23, F33, LIMIT = 9.4e6, 8.7e6, 2.0e4, 60.0, 16.4e3
PATCH = {"a": 6e-3, "b": 4.5e-3, "G": 8.2e10, "c11": 4.43, "c22": 4.08, "c23": 1.82, "load": 54.5e3, "friction": 0.3}
KALKER = LinearKalker(F11, F22, F23, F33)
SHE = ShenHedrickElkins(F11, F22, LIMIT, F23)
VJ = VermeulenJohnson(C=6.563e6, limit=1e4)
POLACH = Polach(**PATCH)
REDUCED = Polach2005(**PATCH, speed=20.0, ratio=0.4, decay=0.6, adhesion=0.9, slip=0.5)
SPINNING = [SHE, POLACH, REDUCED]
SATURATED = [(SHE, LIMIT), (VJ, 1e4), (POLACH, 0.3 * 54.5e3)]

# Points (xi, eta, phi) and forces computed by independent scripts, all printed to ten digits
POINTS = [
    ((1e-4, 0, 0), (-922.1550257, 0), (-1050.187644, 0), (-979.3534605, 0)),
    ((1e-3, 0, 0), (-7718.440302, 0), (-7416.300029, 0), (-8596.11605, 0)),
    ((1e-3, 1e-3, 0), (-7165.25496, -6631.672144), (-6049.84713, -6723.019408), (-7535.725494, -7535.725494)),
    ((5e-4, -1e-3, -0.2), (-3525.059681, 9525.161266), (-3391.982493, 7538.82326), (-2960.902803, 9630.533799)),
    ((5e-3, 2e-3, 0.05), (-15271.4226, -5978.599485), (-9137.898634, -4061.872543), (-14539.04442, -6209.524482)),
]
WITHOUT_SPIN = [
    ((5e-4, -1e-3), (-3818.662984, 7068.588928), (-3982.74102, 7965.482041)),
    ((5e-3, 2e-3), (-15379.86899, -5693.823838), (-14839.61416, -5935.845663)),
]


@pytest.mark.parametrize(("at", "she", "vj", "polach"), POINTS)
def test_points(at, she, vj, polach):
    assert SHE.force(*at) == pytest.approx(she, rel=1e-9)
    assert VJ.force(*at[:2]) == pytest.approx(vj, rel=1e-9)
    assert POLACH.force(*at) == pytest.approx(polach, rel=1e-9)


@pytest.mark.parametrize(("at", "she", "polach"), WITHOUT_SPIN)
def test_points_without_spin(at, she, polach):
    assert SHE.force(*at) == pytest.approx(she, rel=1e-9)
    assert POLACH.force(*at) == pytest.approx(polach, rel=1e-9)


def test_linear_forces_and_moment():
    assert KALKER.force(5e-4, -1e-3, -0.2) == pytest.approx((-4700.0, 12700.0), rel=1e-14)
    assert KALKER.moment(5e-4, -1e-3, -0.2) == pytest.approx(-8.0, rel=1e-14)


def polach_as_printed(xi, eta, phi, a, b, G, c11, c22, c23, load, friction):
    """The formulas of the paper, line by line, without spin where phi = 0; 0/0 at rest."""
    shifted = eta + phi * a
    lateral = shifted if abs(shifted) > abs(eta) else eta
    total, slip = np.hypot(xi, lateral), np.hypot(xi, eta)
    c = np.hypot(c11 * xi / slip, c22 * eta / slip)
    eps = G * np.pi * a * b * c * total / (4 * load * friction)
    F = 2 * load * friction / np.pi * (eps / (1 + eps**2) + np.arctan(eps))
    K = 1 + 6.3 * (1 - np.exp(-a / b))
    eps = 8 * b * np.sqrt(a * b) * G * c23 * abs(lateral) / (3 * K * load * friction)
    d = (eps**2 - 1) / (eps**2 + 1)
    spin = 9 / 16 * a * friction * K * (eps * (-(d**3) / 3 + d**2 / 2 - 1 / 6) + (1 - d**2) ** 1.5 / 3)
    return -F * xi / total, -(F * eta + load * spin * phi) / total


def test_polach_is_the_formula_of_the_paper():
    for xi, eta, phi in np.random.default_rng(1).normal(size=(20, 3)) * [5e-3, 5e-3, 0.3]:
        assert POLACH.force(xi, eta, phi) == pytest.approx(polach_as_printed(xi, eta, phi, **PATCH), rel=1e-12)


def test_extension_without_reduction_is_the_law_of_1999():
    same = Polach2005(**PATCH, speed=20.0, ratio=1.0, decay=0.6)
    at = (2e-3, -1e-3, 0.1)
    assert same.force(*at) == pytest.approx(POLACH.force(*at), rel=1e-14)


def test_friction_falls_to_its_ratio():
    fast = -REDUCED.force(1e6, 0.0)[0]
    assert fast == pytest.approx(0.4 * 0.3 * 54.5e3, rel=1e-3)


def slopes(law, spin=True):
    x = ca.SX.sym("x", 3 if spin else 2)
    f = ca.vertcat(*law.force(*ca.vertsplit(x)))
    return ca.Function("slopes", [x], [f, ca.jacobian(f, x)])


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (KALKER, (F11, F22, F23)),
        (SHE, (F11, F22, F23)),
        (POLACH, (8.2e10 * 2.7e-5 * 4.43, 8.2e10 * 2.7e-5 * 4.08, 8.2e10 * 2.7e-5**1.5 * 1.82)),
        (VJ, (6.563e6 / 0.60252, 6.563e6 / 0.54219)),
    ],
    ids=lambda v: type(v).__name__,
)
def test_value_and_slopes_at_zero_are_exact(law, expected):
    force, J = slopes(law, len(expected) == 3)([0] * len(expected))
    exact = np.zeros((2, len(expected)))
    exact[0, 0], exact[1, 1:] = -expected[0], np.negative(expected[1:])
    assert not force.full().any()
    np.testing.assert_allclose(J.full(), exact, rtol=1e-14)


def test_reduced_slopes_at_zero():
    _, J = slopes(REDUCED)([0, 0, 0])
    assert J.full()[0, 0] == pytest.approx(-0.7 * 8.2e10 * 2.7e-5 * 4.43, rel=1e-14)


@pytest.mark.parametrize("law", [SHE, POLACH, REDUCED, VJ], ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("at", [(0, 0, 0), (1e-200, 0, 0), (0, 1e-160, 0), (0, 0, 0.1), (1e-3, 0, 0), (10, -10, 5)])
def test_derivatives_are_finite_and_those_of_the_values(law, at):
    spin = law is not VJ
    at = np.array(at[: 3 if spin else 2], dtype=float)
    f = slopes(law, spin)
    assert np.isfinite(f(at)[1].full()).all()
    if at[0] == 1e-3:  # a smooth point
        step = 1e-7
        for i in range(2):
            shift = step * np.eye(len(at))[i]
            difference = (f(at + shift)[0] - f(at - shift)[0]).full().ravel() / (2 * step)
            np.testing.assert_allclose(f(at)[1].full()[:, i], difference, rtol=1e-6, atol=1)


@pytest.mark.parametrize(("law", "limit"), SATURATED, ids=lambda v: type(v).__name__)
def test_forces_oppose_and_saturate(law, limit):
    angles = np.linspace(0, 2 * np.pi, 17)
    for size in (1e-5, 1e-3, 1e-2, 1.0):
        Fx, Fy = law.force(size * np.cos(angles), size * np.sin(angles))
        assert (Fx * np.cos(angles) + Fy * np.sin(angles) < 0).all()
        assert (np.hypot(Fx, Fy) <= limit * (1 + 1e-12)).all()
    assert np.hypot(Fx, Fy) == pytest.approx(np.full(17, limit), rel=1e-5)


@pytest.mark.parametrize("law", [KALKER, *SPINNING, VJ], ids=lambda v: type(v).__name__)
def test_mirrored_creepages_give_mirrored_forces(law):
    at = (1e-3, -2e-3) if law is VJ else (1e-3, -2e-3, 0.05)
    Fx, Fy = law.force(*at)
    assert law.force(*np.negative(at)) == pytest.approx((-Fx, -Fy), rel=1e-14)
    assert law.force(at[0], *np.negative(at[1:])) == pytest.approx((Fx, -Fy), rel=1e-14)


def test_she_is_twice_differentiable_where_it_saturates():
    x = ca.SX.sym("x")
    F = SHE.force(x, 0.0)[0]
    second = ca.Function("second", [x], [ca.hessian(F, x)[0]])
    kink = 3 * LIMIT / F11
    assert abs(second(kink * (1 - 1e-9)) - second(kink * (1 + 1e-9))) < 1e-6 * abs(second(kink / 2))


@pytest.mark.parametrize("law", [SHE, VJ, POLACH], ids=lambda v: type(v).__name__)
def test_hopf_point_of_a_wheelset_is_that_of_linear_creep(law):
    """The closed form of a wheelset on springs ky, kpsi to a fixed frame; the laws differ in their slopes only."""
    m, inertia, a, r0, ky, kpsi, lam = 1813.0, 1120.0, 0.75, 0.46, 1e5, 1e5, 0.2
    y, psi = Coordinate("y", "m", "lateral"), Coordinate("psi", "rad", "yaw")
    V = Parameter("V", 20.0, "m/s", "speed", (0.1, 500.0))
    xi, eta = a * psi.dot / V + lam * y / r0, y.dot / V - psi
    Fx, Fy = law.force(xi, eta)
    equations = [m * y.ddot + ky * y - 2 * Fy, inertia * psi.ddot + kpsi * psi - 2 * a * Fx]
    (point,) = hopf_points(System("wheelset", [y, psi], [V], equations), "V", (5.0, 80.0))
    (k11, _), (_, k22) = -slopes(law, law is not VJ)([0] * (2 if law is VJ else 3))[1].full()[:, :2]
    omega2 = (k22 * kpsi + a**2 * k11 * ky) / (m * a**2 * k11 + inertia * k22)
    stiff = (ky - m * omega2) * (kpsi - inertia * omega2) + 4 * k11 * k22 * a * lam / r0
    assert point.value == pytest.approx(np.sqrt(4 * a**2 * k11 * k22 * omega2 / stiff), rel=1e-9)
    assert point.omega == pytest.approx(np.sqrt(omega2), rel=1e-9)


def test_coefficients_may_be_parameters():
    """The derivative with respect to the limit is that of the closed form: e(u) F at u = F/limit."""
    limit = Parameter("muN", LIMIT, "N", "friction")
    F = ShenHedrickElkins(F11, F22, limit).force(2e-3, 0.0)[0]
    value, slope = ca.Function("F", [limit], [F, ca.jacobian(F, limit)])(LIMIT)
    u = F11 * 2e-3 / LIMIT
    assert float(value) == pytest.approx(-LIMIT * (u - u**2 / 3 + u**3 / 27), rel=1e-14)
    assert float(slope) == pytest.approx(-(u**2 / 3 - 2 * u**3 / 27), rel=1e-12)


def test_what_is_refused():
    with pytest.raises(ModelError, match=r"ShenHedrickElkins: limit is 0; give a finite number above 0"):
        ShenHedrickElkins(F11, F22, 0.0)
    with pytest.raises(ModelError, match=r"Polach: load is -1; give a finite number above 0"):
        Polach(**PATCH | {"load": -1.0})
    with pytest.raises(ModelError, match=r"Polach2005: decay is -1; give a finite number, 0 or more"):
        Polach2005(**PATCH, speed=20.0, ratio=0.4, decay=-1.0)
    with pytest.raises(ModelError, match=r"outside Kalker's table; give 0\.1 to 10"):
        kalker_coefficients(11.0)
    with pytest.raises(ModelError, match="Poisson's ratio nu = 'steel' is outside"):
        kalker_coefficients(1.0, "steel")
    with pytest.raises(ModelError, match="creepages: got inf; give finite numbers"):
        VJ.force(np.inf, 0.0)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"wheel_profile_radius": -0.2}, "is no ellipse"),
        ({"wheel_profile_radius": 0.0}, "got 0.0; give a number in m, negative for a hollow wheel"),
        ({"wheel_profile_radius": "flat"}, "got 'flat'; give a number in m"),
        ({"nu": 1.0}, "nu = 1.0; give a number above -1 and up to 0.5"),
        ({"shear": 0.0}, "shear: got 0.0; give a finite number above 0 in Pa"),
    ],
)
def test_ellipses_that_are_refused(wrong, words):
    with pytest.raises(ModelError, match=words):
        hertz_ellipse(1e4, 0.46, 0.3, **wrong)


# Kalker 1990, Table E.3, as C. Kaas-Petersen and others use it
@pytest.mark.parametrize(
    ("ratio", "nu", "expected"),
    [
        (1.0, 0.25, (4.12, 3.67, 1.47, 1.19)),
        (1.0, 0.0, (3.40, 3.40, 1.33, 1.21)),
        (0.1, 0.25, (3.31, 2.52, 0.473, 8.28)),
        (10.0, 0.25, (11.7, 12.8, 14.6, 0.526)),
        (0.5, 0.5, (4.83, 3.14, 1.07, 2.22)),
        (1 / 0.4, 0.25, (5.57, 5.48, 3.24, 0.747)),
    ],
)
def test_rows_of_kalkers_table(ratio, nu, expected):
    assert kalker_coefficients(ratio, nu) == pytest.approx(expected, rel=1e-12)


def test_table_is_continuous_and_monotone_between_its_rows():
    ratios = np.geomspace(0.1, 10, 801)
    c = np.array([kalker_coefficients(r, 0.28) for r in ratios])
    assert (np.diff(c[:, :3], axis=0) > 0).all() and (np.diff(c[:, 3]) < 0).all()
    assert np.abs(np.diff(c, axis=0) / c[1:]).max() < 0.02


def test_hertz_circle_and_scaling():
    """Equal curvatures: a^3 = 3 P R / (4 E*). Semi-axes grow with the cube root of the load; axes swap with radii."""
    circle = hertz_ellipse(1e4, 0.3, 0.3, shear=8e10, nu=0.25)
    exact = (3 * 1e4 * 0.3 / (4 * 8e10 / 0.75)) ** (1 / 3)
    assert (circle.a, circle.b) == pytest.approx((exact, exact), rel=1e-12)
    one, eight = hertz_ellipse(1e4, 0.46, 0.3), hertz_ellipse(8e4, 0.46, 0.3)
    assert (eight.a, eight.b) == pytest.approx((2 * one.a, 2 * one.b), rel=1e-12)
    swapped = hertz_ellipse(1e4, 0.3, 0.46)
    assert (swapped.a, swapped.b) == pytest.approx((one.b, one.a), rel=1e-12)


def test_hertz_ellipse_carries_its_load_with_its_curvatures():
    """The pressure p0 sqrt(1 - x^2/a^2 - y^2/b^2) bends the surface by what the gap asks for: the two integrals of
    the ellipse, by quadrature instead of elliptic functions."""
    load, along, across = 5e4, 1 / 0.46, 1 / 0.3 - 1 / 0.8
    e = hertz_ellipse(load, 0.46, 0.3, -0.8)
    w = (np.arange(400) + 0.5) / 400 * np.pi / 2  # midpoints of a quarter turn
    modulus = e.shear / (1 - e.nu)
    stretched = np.sqrt(e.a**2 * np.cos(w) ** 2 + e.b**2 * np.sin(w) ** 2)
    share = np.array([np.mean(np.cos(w) ** 2 / stretched**3), np.mean(np.sin(w) ** 2 / stretched**3)]) * np.pi / 2
    curvatures = 3 * load / (np.pi * modulus) * share
    assert curvatures == pytest.approx([along, across], rel=1e-9)


def test_law_of_an_ellipse():
    law = ContactEllipse(6e-3, 6e-3, shear=8e10, nu=0.25).kalker()
    area = 36e-6
    expected = (8e10 * area * 4.12, 8e10 * area * 3.67, 8e10 * area**1.5 * 1.47, 8e10 * area**2 * 1.19)
    assert (law.f11, law.f22, law.f23, law.f33) == pytest.approx(expected, rel=1e-12)


def test_simple_bogie_without_flange():
    """H. True's bogie of two coordinates: a rigid frame on two wheelsets, bounded by the saturation of creep alone.

    Hopf point and cycles as computed by other programs; all their printed digits.
    """
    q1, q2 = Coordinate("q1", "m", "lateral"), Coordinate("q2", "rad", "yaw")
    V = Parameter("V", 70.0, "m/s", "speed", (1.0, 300.0))
    m, inertia, ha, D2, k4, k6, a, lam, r0 = 4963.0, 8135.0, 1.074, 29200.0, 0.1823e6, 2.71e6, 0.716, 0.05, 0.4572
    law = VermeulenJohnson(6.563e6, 1e4, psi=0.54219, phi=0.60252)
    (Fx1, Fy1), (Fx2, Fy2) = (
        law.force(a * q2.dot / V + lam / r0 * (q1 + s * ha * q2), q1.dot / V - q2 + s * ha * q2.dot / V)
        for s in (1, -1)
    )
    lateral = m * q1.ddot + 2 * D2 * q1.dot + 2 * k4 * q1 - 2 * (Fy1 + Fy2)
    yaw = inertia * q2.ddot + k6 * q2 - 2 * ha * (Fy1 - Fy2) - 2 * a * (Fx1 + Fx2)
    bogie = System("simple bogie", [q1, q2], [V], [lateral, yaw])
    (hopf,) = hopf_points(bogie, "V", (60.0, 75.0))
    assert hopf.value == pytest.approx(66.7408, abs=5e-5) and hopf.omega == pytest.approx(14.3392, abs=5e-5)
    for speed, peak, omega in ((64.0, 0.038108, 12.954), (100.0, 0.037400, 15.499), (140.0, 0.034871, 16.662)):
        cycle = verify(bogie, find_cycles(bogie, V=speed)[-1])  # exact, by shooting
        assert cycle.orbit.stability.verdict == "stable"
        assert cycle.amplitudes["q1"] == pytest.approx(peak, abs=5e-7)
        assert cycle.orbit.omega == pytest.approx(omega, abs=5e-4)


ODD = [(0.0, 0.0, 0.1), (0.0, 0.0, -3.0), (1e-9, 0.0, 0.0), (0.0, -1e-9, 1e-6), (50.0, -70.0, 0.0), (1e9, 1e9, 0.0)]


@pytest.mark.parametrize("at", ODD)
def test_odd_creepages_by_formulas_written_again(at):
    """Spin alone, hardly any creepage, and creepages far beyond what slides."""
    xi, eta, phi = at
    linear = np.array([-F11 * xi, -F22 * eta - F23 * phi])
    u = np.hypot(*linear) / LIMIT
    e = (1 - (1 - u / 3) ** 3) / u if u < 3 else 1 / u  # Johnson and Vermeulen, as they print it
    assert SHE.force(*at) == pytest.approx(e * linear, rel=1e-6 if u < 1e-3 else 1e-12)  # 1 - (1 - u/3)^3 cancels
    g = np.array([-6.563e6 / 0.60252 * xi, -6.563e6 / 0.54219 * eta])
    u = np.hypot(*g) / 1e4
    e = 0.0 if u == 0 else (1 - (1 - u / 3) ** 3) / u if u < 3 else 1 / u
    assert VJ.force(xi, eta) == pytest.approx(e * g, rel=1e-6 if u < 1e-3 else 1e-12)
    if np.hypot(xi, eta) > 0:
        assert POLACH.force(*at) == pytest.approx(polach_as_printed(*at, **PATCH), rel=1e-6)


def test_polach_of_spin_alone():
    """Only the spin acts: F_S of the paper with the effective lateral creepage phi a, times load and spin."""
    beside = polach_as_printed(0.0, 1e-13, 0.1, **PATCH)
    assert POLACH.force(0.0, 0.0, 0.1) == pytest.approx(beside, rel=1e-6)


def test_arrays_are_points_side_by_side():
    xi, eta = np.meshgrid([0.0, 1e-3, 1.0], [-1e-3, 0.0])
    for law in (KALKER, SHE, VJ, POLACH, REDUCED):
        Fx, Fy = law.force(xi, eta)
        assert Fx.shape == Fy.shape == (2, 3)
        for i, j in np.ndindex(2, 3):
            assert law.force(xi[i, j], eta[i, j]) == (Fx[i, j], Fy[i, j])


@pytest.mark.parametrize("law", [KALKER, SHE, VJ, POLACH, REDUCED], ids=lambda v: type(v).__name__)
@pytest.mark.parametrize(
    "at", [("a", 0.0), (None, 0.0), (np.nan, 0.0), (np.inf, 0.0), (1e150, 0.0), ([1.0, 2.0], [1, 2, 3])]
)
def test_creepages_that_are_no_numbers(law, at):
    with pytest.raises(ModelError, match="creepages"):
        law.force(*at)


@pytest.mark.parametrize("load", [-1.0, 0.0, np.nan])
def test_normal_force_is_positive(load):
    for made in (lambda: Polach(**{**PATCH, "load": load}), lambda: ShenHedrickElkins(F11, F22, load)):
        with pytest.raises(ModelError, match="above 0"):
            made()
