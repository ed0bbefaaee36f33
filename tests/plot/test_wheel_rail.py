"""Figures of contact geometry and conicity."""

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt

from hbbogie import ModelError, plot
from hbbogie.results import Conicity, ContactGeometry

matplotlib.use("Agg")
SHIFT = np.linspace(-2, 2, 5)


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


def made_up():
    numbers = [SHIFT * k for k in range(1, 11)]
    return ContactGeometry("wheel", "rail", SHIFT, *numbers)


def test_radius_difference_is_drawn_over_the_shift():
    found = made_up()
    (line,) = plot.contact(found).lines
    np.testing.assert_array_equal(line.get_xdata(), SHIFT)
    np.testing.assert_array_equal(line.get_ydata(), found.radius_difference)


def test_angles_are_in_degrees_and_points_on_wheel_and_rail():
    found = made_up()
    right, left = plot.contact(found, y="contact angle").lines
    np.testing.assert_allclose(right.get_ydata(), np.degrees(found.angle_right))
    np.testing.assert_allclose(left.get_ydata(), np.degrees(found.angle_left))
    assert len(plot.contact(found, y="contact point").lines) == 4
    with pytest.raises(ModelError, match=r"unknown quantity 'contact angel'\. Did you mean 'contact angle'\?"):
        plot.contact(found, y="contact angel")


def test_conicity_has_a_line_for_each_definition():
    curve = Conicity(np.arange(1.0, 4.0), np.zeros(3), np.full(3, 0.1), np.full(3, 0.2), np.full(3, 0.3))
    ax = plot.conicity(curve)
    assert [line.get_ydata()[0] for line in ax.lines] == [0.1, 0.2, 0.3]
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["EN 15302", "least squares", "describing function"]


def test_results_print_in_few_lines_and_draw_themselves():
    found = made_up()
    assert repr(found).startswith("Contact of wheel on rail: 5 lateral shifts, -2 to 2 mm\n")
    assert len(found.plot(y="contact angle").lines) == 2
    assert "<img" in found._repr_html_()
    curve = Conicity(np.arange(1.0, 9.0), np.zeros(8), np.full(8, 0.1), np.full(8, 0.2), np.full(8, 0.3))
    assert repr(curve).startswith("Equivalent conicity at 8 amplitudes\n") and "0.1 at 6 mm and 2 more" in repr(curve)
    assert len(curve.plot().lines) == 3
