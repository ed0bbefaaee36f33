"""Exact integration of ramps between contact times."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hbbogie import fourier
from hbbogie.methods import make_ramp

RNG = np.random.default_rng(1)


def _signal(harmonics, level):
    rows = fourier.rows_of(harmonics)
    h = np.maximum((rows + 1) // 2, 1)
    c = RNG.standard_normal(len(rows)) / h**3
    first = np.flatnonzero(rows == 1)[0]
    c[first], c[first + 1] = 0.8, 0.6  # a unit first harmonic: the level is in units of it
    if rows[0] == 0:
        c[0] = 0.1
    return rows, np.concatenate([[-level], c])


def _coefficients(ramp, w):
    moments, _, _ = ramp.contacts(w)
    return (ramp.gain(moments) @ w).full().ravel()


@pytest.mark.parametrize("level", [0.2, 0.5, 0.9])
def test_coefficients_are_those_of_fine_sampling(level):
    """ORDER: sampling converges like N^-2 to the exact integral; at N = 2^17 it is near 1e-9."""
    harmonics = tuple(range(8))
    rows, w = _signal(harmonics, level)
    exact = _coefficients(make_ramp(harmonics, half=False), w)
    full = np.zeros(15)
    full[rows] = w[1:]
    errors = []
    for N in (2**9, 2**13, 2**17):
        s = fourier.synthesis(7, fourier.phases(N)) @ full + w[0]
        errors.append(np.abs((fourier.analysis(7, N) @ np.maximum(s, 0))[rows] - exact).max())
    assert errors[-1] < 1e-8
    assert errors[-1] < errors[0] / 1e3


def test_half_a_period_is_enough_for_odd_signals():
    harmonics = (1, 3, 5)
    rows, w = _signal(harmonics, 0.5)
    half = make_ramp(harmonics, half=True)
    mirrored = np.concatenate([w[:1], -w[1:]])
    pair = _coefficients(half, w) - _coefficients(half, mirrored)
    everything = (0, 1, 2, 3, 4, 5)
    full_rows = fourier.rows_of(everything)
    whole = make_ramp(everything, half=False)
    W = np.zeros(12)
    W[0], W[1:][np.isin(full_rows, rows)] = w[0], w[1:]
    mirror = np.concatenate([W[:1], -W[1:]])
    expected = (_coefficients(whole, W) - _coefficients(whole, mirror))[np.isin(full_rows, rows)]
    np.testing.assert_allclose(pair, expected, atol=1e-14)


def test_closed_form_of_one_harmonic():
    """First Fourier coefficient of max(Y cos t - g, 0): (Y/pi)(t0 - sin(2 t0)/2), t0 = arccos(g/Y)."""
    Y, g = 1.5, 1.0
    t0 = np.arccos(g / Y)
    c = _coefficients(make_ramp((0, 1), half=False), np.array([-g, 0.0, Y, 0.0]))
    assert c[1] == pytest.approx(Y / np.pi * (t0 - np.sin(2 * t0) / 2), rel=1e-14)
    assert c[0] == pytest.approx((Y * np.sin(t0) - g * t0) / np.pi, rel=1e-13)
    assert abs(c[2]) < 1e-15


def test_grazing_contacts_shorter_than_a_grid_cell_are_met():
    """A contact of height d lasts 2 sqrt(2 d); its area, to leading order, is (4/3) d sqrt(2 d)."""
    ramp = make_ramp((1,), half=True)
    for d in (1e-4, 1e-6):
        w = np.array([-(1 - d), np.cos(1.0), np.sin(1.0)])  # peak at tau = 1
        _, times, weights = ramp.contacts(w)
        touching = times.full()[weights.full() > 0]
        np.testing.assert_allclose(np.sort(touching), 1 + np.arccos(1 - d) * np.array([-1, 1]), rtol=1e-9)
        area = _coefficients(ramp, w) @ np.array([np.cos(1.0), np.sin(1.0)]) * np.pi / 2
        assert area == pytest.approx(4 / 3 * d * np.sqrt(2 * d), rel=3 * d)


def test_no_contact_gives_exactly_nothing_and_full_contact_the_signal():
    ramp = make_ramp((0, 1, 2), half=False)
    w = np.array([-10.0, 0.0, 1.0, 0.5, 0.1, -0.2])
    assert not _coefficients(ramp, w).any()
    w[0] = 10.0
    np.testing.assert_allclose(_coefficients(ramp, w), [10.0, 1.0, 0.5, 0.1, -0.2], atol=1e-13)


def test_second_derivative_counts_the_moving_contact_times():
    """Curvature against the change of the gain matrix, whose entries are the first derivatives."""
    harmonics = (0, 1, 2, 3)
    _, w = _signal(harmonics, 0.4)
    ramp = make_ramp(harmonics, half=False)
    lam = RNG.standard_normal(7)
    sym = ca.MX.sym("w", 8)
    _, times, weights = ramp.contacts(sym)
    H = ca.Function("H", [sym], [ramp.curvature(times, weights, ca.DM(lam))])(w).full()
    step, rows = 1e-6, []
    for e in np.eye(8):
        plus, minus = (ramp.gain(ramp.contacts(w + s * step * e)[0]).full() for s in (1, -1))
        rows.append(lam @ (plus - minus) / (2 * step))
    np.testing.assert_allclose(H, np.array(rows), atol=1e-7 * np.abs(H).max())
