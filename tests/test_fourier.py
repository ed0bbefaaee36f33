"""The harmonic basis. Class IDENTITY unless said otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from hbbogie import fourier

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("H", [1, 4, 15])
def test_analysis_after_synthesis_is_the_identity(H):
    N = 2 * H + 2
    product = fourier.analysis(H, N) @ fourier.synthesis(H, fourier.phases(N))
    np.testing.assert_allclose(product, np.eye(2 * H + 1), atol=1e-13)


@pytest.mark.parametrize("order", [0, 1, 2, 3, 5])
def test_derivative_agrees_with_derived_synthesis(order):
    c, tau = RNG.standard_normal((9, 2)), RNG.uniform(0, 7, 11)
    np.testing.assert_allclose(
        fourier.synthesis(4, tau) @ fourier.derivative(c, order),
        fourier.synthesis(4, tau, order) @ c,
        atol=1e-10,
    )


def test_shift_moves_the_time_origin():
    c, tau = RNG.standard_normal((9, 2)), RNG.uniform(0, 7, 11)
    np.testing.assert_allclose(
        fourier.synthesis(4, tau) @ fourier.shift(c, 0.7), fourier.synthesis(4, tau + 0.7) @ c, atol=1e-13
    )


def test_resize_keeps_the_common_harmonics():
    c = RNG.standard_normal((9, 2))
    np.testing.assert_array_equal(fourier.resize(fourier.resize(c, 7), 4), c)
    np.testing.assert_array_equal(fourier.resize(c, 2), c[:5])


def test_odd_signals_are_told_from_others():
    c = np.zeros((9, 1))
    c[[1, 6]] = 1.0
    assert fourier.is_odd(c)
    c[3] = 1e-3
    assert not fourier.is_odd(c)


def test_extremes_of_a_sum_of_two_waves():
    # cos t + 0.25 cos 2t: largest at t = 0 (1.25), smallest at t = pi, where the derivative
    # -sin t - 0.5 sin 2t = -sin t (1 + cos t) vanishes only there: -0.75
    c = np.array([[0.0], [1.0], [0.0], [0.25], [0.0]])
    low, high = fourier.extremes(c)
    assert low[0] == pytest.approx(-0.75, abs=1e-12)
    assert high[0] == pytest.approx(1.25, abs=1e-14)


def test_extremes_are_refined_between_samples():
    c = np.array([[0.3], [np.cos(0.1234)], [np.sin(0.1234)]])
    low, high = fourier.extremes(c)
    np.testing.assert_allclose([low[0], high[0]], [-0.7, 1.3], atol=1e-14)


def test_rows_of_harmonics():
    assert list(fourier.rows_of((0, 1, 3))) == [0, 1, 2, 5, 6]
