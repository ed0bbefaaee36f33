"""Identification: known systems are recovered, the creep coefficients of Table 1 come out."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.design import Parametrisation, identify

problem = hb.load_problem("yang1995")
# Table 1, equivalent linearisation. Amplitudes a1 were prescribed: held. The printed speeds scatter by 0.05 m/s about
# any fit, ten times their last digit, the frequencies by 0.005 rad/s and a2 by 0.03 mm, about half their last digits.
SIGMA = {"V": 0.05, "omega": 0.005, "q1": 0.0, "q3": 5e-5}
# state 1 is the Hopf point: below contact (9.1 mm) the amplitude does not matter
ROWS = [{"V": s.V, "omega": s.omega_el, "q1": s.a1_el or 0.004, "q3": s.a2_el} for s in problem.TABLE_1]
LOOSE = tuple(i for i, s in enumerate(problem.TABLE_1) if s.state in (4, 5, 6, 12))
CREEP = ("f11", "f22", "f23")
G = 80.8e9  # N/m2


def kalker(Gab):
    """Creep coefficients by Kalker's linear theory at nu = 1/4, b/a = 0.7, over G a b [N]."""
    ab = Gab / G
    return {"f11": 4.54 * Gab, "f22": 4.21 * Gab, "f23": 1.95 * G * ab**1.5, "f33": 0.965 * G * ab**2}


@pytest.fixture(scope="module")
def one(bogie):
    return hb.HarmonicBalance(1).equations(bogie)


@pytest.fixture(scope="module")
def from_elsewhere():
    """One harmonic of a bogie whose creep coefficients are 3 % off: where the search begins."""
    return hb.HarmonicBalance(1).equations(problem.bogie(f11=10.0e6, f22=9.3e6, f23=20e3))


@pytest.fixture(scope="module")
def chosen(from_elsewhere):
    return identify(from_elsewhere, ROWS, CREEP, sigma=SIGMA, exclude=LOOSE)


@pytest.fixture(scope="module")
def robust(one):
    return identify(one, ROWS, CREEP, sigma=SIGMA, robust=True)


@pytest.mark.parametrize("which", ["chosen", "robust"])
def test_creep_coefficients_of_table_1(which, request):
    """PUBLISHED indirectly: 10.34 MN, 9.59 MN, 22 kN m, by chosen states and by all states with weights."""
    found = request.getfixturevalue(which)
    assert found.estimates["f11"] == pytest.approx(10.34e6, abs=0.02e6)
    assert found.estimates["f22"] == pytest.approx(9.59e6, abs=0.02e6)
    assert found.estimates["f23"] == pytest.approx(22e3, abs=2e3)
    for name, largest in (("f11", 8e3), ("f22", 4e3), ("f23", 1.5e3)):
        assert 0 < found.errors[name] < largest


def test_two_ways_agree_within_their_errors(chosen, robust):
    for name in CREEP:
        assert abs(chosen.estimates[name] - robust.estimates[name]) < 2 * (chosen.errors[name] + robust.errors[name])


def test_state_6_is_the_outlier(robust):
    """Its printed speed is 2.03 m/s below what its frequency and amplitudes say: a misprint for 94.22."""
    place = next(i for i, s in enumerate(problem.TABLE_1) if s.state == 6)
    assert robust.outliers == (place,)
    speed = robust.quantities.index("V")
    assert robust.residuals[place, speed] == pytest.approx(92.22 - 94.25, abs=0.03)
    assert robust.weights[place, speed] < 0.01 < 0.5 < np.delete(robust.weights[:, speed], place).min()


def test_misfit_row_by_row(chosen):
    """Rows left out are shown too; a2 of the Hopf point was not measured."""
    assert chosen.residuals.shape == (14, 4) == chosen.weights.shape
    speed, omega, front, rear = (chosen.quantities.index(n) for n in ("V", "omega", "q1", "q3"))
    assert np.isnan(chosen.residuals[0, rear]) and np.isfinite(np.delete(chosen.residuals.ravel(), 4 * 0 + rear)).all()
    assert not chosen.weights[list(LOOSE)].any()
    used = np.delete(chosen.residuals, LOOSE, axis=0)
    assert np.abs(used[:, speed]).max() < 0.1 and np.abs(used[:, omega]).max() < 0.02
    assert np.abs(used[:, front]).max() < 1e-12 and np.nanmax(np.abs(used[:, rear])) < 5.5e-5
    for row, orbit, misfit in zip(ROWS, chosen.orbits, chosen.residuals, strict=True):
        assert orbit.omega == pytest.approx(row["omega"] - misfit[omega], rel=1e-12)
        assert orbit.parameters["V"] == pytest.approx(row["V"] - misfit[speed], rel=1e-12)
        assert orbit.parameters["f11"] == chosen.estimates["f11"]
        assert orbit.residual < 1e-8


@pytest.mark.parametrize("exclude", [LOOSE, ()], ids=["chosen", "all, robust"])
def test_one_number_of_kalker(one, exclude):
    """PUBLISHED: G a b = 2.277 MN within 0.2 %; all four creep coefficients follow."""
    found = identify(
        one, ROWS, Parametrisation({"Gab": 2.2e6}, kalker), sigma=SIGMA, exclude=exclude, robust=not exclude
    )
    assert found.estimates["Gab"] == pytest.approx(2.277e6, rel=2e-3)
    assert found.parameters == pytest.approx(kalker(found.estimates["Gab"]), rel=1e-12)
    assert found.parameters["f33"] == pytest.approx(61.9, rel=5e-3)
    assert found.correlation == pytest.approx(np.ones((1, 1)))


def test_the_flange_stiffness_comes_out_as_printed(one):
    found = identify(one, ROWS, (*CREEP, "K0"), sigma=SIGMA, robust=True)
    assert found.estimates["K0"] == pytest.approx(20e6, rel=2e-3)


# --- truths ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma_q1", [0.0, 5e-5], ids=["a1 held", "a1 weighed"])
@pytest.mark.parametrize("harmonics", [1, 3])
def test_a_bogie_is_recovered(bogie, harmonics, sigma_q1):
    """SOLVER: rows computed from a known system give its parameters back."""
    truth = {"f11": 10.9e6, "f22": 9.2e6, "f23": 30e3}
    there = hb.HarmonicBalance(harmonics).equations(problem.bogie(**truth))
    orbit = hb.find_cycles(there.system, V=110.0, stability=False)[-1]
    rows = []
    for a1 in (0.0110, 0.0130, 0.0160, 0.0200):
        orbit = hb.solve(there, orbit, amplitude={"q1": a1}, free="V")
        rows.append({"V": orbit.parameters["V"], "omega": orbit.omega, "q1": a1, "q3": orbit.first_harmonic("q3")})
    here = hb.HarmonicBalance(harmonics).equations(bogie)
    found = identify(here, rows, tuple(truth), sigma=SIGMA | {"q1": sigma_q1})
    assert found.estimates == pytest.approx(truth, rel=1e-6)
    assert found.outliers == () and found.sum_of_squares < 1e-9


A = np.linspace(0.2, 2.0, 25)


def _backbone(alpha, beta, noise=0.0):
    """Frequency of one harmonic of the Duffing oscillator over amplitude, in closed form."""
    return np.sqrt(alpha + 0.75 * beta * A**2) + noise * np.random.default_rng(1).standard_normal(A.size)


@pytest.fixture(scope="module")
def duffing():
    return hb.HarmonicBalance(1).equations(hb.load_problem("duffing").duffing())


def _rows(omega):
    return [{"x": a, "omega": w, "d": None} for a, w in zip(A, omega, strict=True)]  # d: its own in each row, unknown


def test_a_backbone_is_recovered(duffing):
    """SOLVER: alpha and beta from frequency over amplitude."""
    found = identify(duffing, _rows(_backbone(1.3, 0.7)), ("alpha", "beta"), sigma={"x": 0.0, "omega": 1e-3})
    assert found.estimates == pytest.approx({"alpha": 1.3, "beta": 0.7}, rel=1e-9)
    assert max(abs(o.parameters["d"]) for o in found.orbits) < 1e-9


def test_errors_are_those_of_least_squares_in_closed_form(duffing):
    """IDENTITY: estimates, standard errors and correlation of a two-parameter fit of the same noisy rows."""
    from scipy.optimize import least_squares

    omega = _backbone(1.3, 0.7, noise=1e-3)
    found = identify(duffing, _rows(omega), ("alpha", "beta"), sigma={"x": 0.0, "omega": 1e-3})

    def model(theta):
        return np.sqrt(theta[0] + 0.75 * theta[1] * A**2)

    fit = least_squares(lambda t: model(t) - omega, (1, 1), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    J = np.column_stack([0.5 / model(fit.x), 0.375 * A**2 / model(fit.x)])
    covariance = np.linalg.inv(J.T @ J) * ((model(fit.x) - omega) ** 2).sum() / (len(A) - 2)
    errors = np.sqrt(np.diag(covariance))
    assert list(found.estimates.values()) == pytest.approx(fit.x, rel=1e-7)
    assert list(found.errors.values()) == pytest.approx(errors, rel=1e-6)
    assert found.correlation[0, 1] == pytest.approx(covariance[0, 1] / np.prod(errors), rel=1e-6)
    assert found.freedom == len(A) - 2


def test_a_wrong_row_is_found_and_loses_its_weight(duffing):
    omega = _backbone(1.3, 0.7, noise=1e-4)
    omega[12] += 0.1
    plain, robust = (
        identify(duffing, _rows(omega), ("alpha", "beta"), sigma={"x": 0.0, "omega": 1e-3}, robust=r)
        for r in (False, True)
    )
    weights = robust.weights[:, robust.quantities.index("omega")]
    assert 12 in robust.outliers and weights.argmin() == 12 and weights[12] < 0.01
    assert abs(robust.estimates["alpha"] - 1.3) < 1e-3 < 1e-2 < abs(plain.estimates["alpha"] - 1.3)


# --- what it refuses ------------------------------------------------------------------------------


def test_errors_say_what_to_do(one):
    for rows, free, sigma, message in (
        (ROWS, ("f1",), SIGMA, "Did you mean 'f11'"),
        (ROWS, "f11", SIGMA, "sequence of parameter names"),
        (ROWS, ("V",), SIGMA, "V has its own value in each row"),
        (ROWS, ("f11", "W"), SIGMA, "do not determine W"),
        (ROWS[:1], ("f11", "f22", "f23"), SIGMA, "do not determine 3 parameters"),
        ([], ("f11",), SIGMA, "no rows"),
        ([{"V": 90.0, "speed": 1.0}], ("f11",), SIGMA, "unknown measured quantity 'speed'"),
        (ROWS, ("f11",), {"V": 0.05, "omega": 0.005, "q1": 0.0}, "also for q3"),
        (ROWS, ("f11",), SIGMA | {"q3": 0.0}, "'q3' has sigma 0 but is not measured in every row"),
        (ROWS, ("f11",), SIGMA | {"V": -1.0}, "at least 0"),
    ):
        with pytest.raises(hb.ModelError, match=message):
            identify(one, rows, free, sigma=sigma)
    with pytest.raises(hb.ModelError, match="places of rows, 0 to 13"):
        identify(one, ROWS, ("f11",), sigma=SIGMA, exclude=(14,))
    with pytest.raises(
        hb.ConvergenceError, match="f33 would leave its bounds"
    ):  # it cannot be negative, as these rows want it
        identify(one, ROWS, ("f11", "f22", "f33"), sigma=SIGMA)
    with pytest.raises(hb.ModelError, match="give guesses="):
        identify(one, [{"V": 90.0, "omega": 28.4}], ("f11",), sigma=SIGMA)
    with pytest.raises(hb.ModelError, match="got 0 guesses for 14 rows"):
        identify(one, ROWS, ("f11",), sigma=SIGMA, guesses=[])
