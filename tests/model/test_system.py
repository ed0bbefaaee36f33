"""Systems: what symbolic analysis finds, and what wrong input is told."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import Coordinate, Element, ModelError, Parameter, System


@pytest.fixture
def x():
    return Coordinate("x", "m")


@pytest.fixture
def y():
    return Coordinate("y", "m")


@pytest.fixture
def c():
    return Parameter("c", 2.0, "1", "a number", (0.0, 10.0))


class TestBogie:
    def test_mass_matrix(self, bogie):
        np.testing.assert_array_equal(bogie.mass(), np.diag([1022, 678, 1022, 678, 2918, 6780, 6780]))

    def test_stiffness_row_of_the_front_wheelset(self, bogie):
        """From the equations: 2 K1 (q1 - q5 - b q6 - h1 q7) - 2 f22 q2 with the printed values."""
        expected = [6e6, -2 * 9.586e6, 0, 0, -6e6, -6e6 * 1.074, -6e6 * 0.0762]
        np.testing.assert_allclose(bogie.stiffness()[0], expected, rtol=1e-14)

    def test_damping_depends_on_speed(self, bogie):
        D50, D100 = bogie.damping(V=50.0), bogie.damping(V=100.0)
        assert D50[0, 0] == pytest.approx(2 * 9.586e6 / 50, rel=1e-14)
        np.testing.assert_allclose(D50[:4, :4], 2 * D100[:4, :4], rtol=1e-14)
        np.testing.assert_array_equal(D50[4:, 4:], D100[4:, 4:])

    def test_only_the_lateral_wheelset_coordinates_are_nonlinear(self, bogie):
        assert bogie.nonlinear_coordinates == ("q1", "q3")

    def test_odd_symmetry_is_found(self, bogie):
        assert bogie.odd

    def test_the_axle_load_is_inactive_without_gravity(self, bogie):
        assert bogie.inactive_parameters == ("W",)
        assert hb.load_problem("yang1995").bogie(gravity=True).inactive_parameters == ()

    def test_pickles(self, bogie):
        twin = pickle.loads(pickle.dumps(bogie.with_parameters(V=77.0)))
        assert twin.values == bogie.with_parameters(V=77.0).values
        np.testing.assert_array_equal(twin.damping(), bogie.damping(V=77.0))


def test_first_and_second_order_forms_have_the_same_flow(x):
    problem = hb.load_problem("van_der_pol")
    second, first = problem.van_der_pol(mu=1.3), problem.van_der_pol_first_order(mu=1.3)
    state = [0.7, -0.4]
    np.testing.assert_allclose(second.ode(state, [1.3]), first.ode(state, [1.3]), rtol=1e-14)
    assert second.second_order == (True,) and first.second_order == (False, False)


def test_mixed_orders(x, y, c):
    system = System("mixed", [x, y], [c], [x.ddot + x + y, y.dot + c * y - x])
    assert system.second_order == (True, False)
    assert system.n_states == 3
    np.testing.assert_allclose(system.ode([1.0, 2.0, 3.0], [2.0]).full().ravel(), [3.0, -3.0, -3.0])


def test_nonlinear_inertia_is_solved_for(x, c):
    system = System("pendulum on a spring", [x], [c], [(1 + x**2) * x.ddot + x * x.dot**2 + c * x])
    np.testing.assert_allclose(system.ode([1.0, 2.0], [2.0]).full().ravel(), [2.0, -(4.0 + 2.0) / 2.0])
    assert system.nonlinear_coordinates == ("x",)


def test_matrices_and_equations_give_the_same_system(x, y, c):
    M, D, K = np.diag([1.0, 2.0]), np.array([[0.1, 0.0], [0.0, 0.3]]), np.array([[3.0, -1.0], [-1.0, 2.0]])
    law = hb.model.DeadBand(5.0, 0.1)
    matrices = System.from_matrices("m", M, D, K, {"stop": (law, [1.0, -1.0])}, coordinates=["x", "y"])
    stop = Element("stop", law, x - y)
    equations = System(
        "e",
        [x, y],
        [],
        [x.ddot + 0.1 * x.dot + 3 * x - y + stop, 2 * y.ddot + 0.3 * y.dot - x + 2 * y - stop],
        [stop],
    )
    state = [0.5, 0.2, 0.3, -0.1]
    np.testing.assert_allclose(matrices.ode(state, []), equations.ode(state, []), rtol=1e-14)
    assert matrices.nonlinear_coordinates == equations.nonlinear_coordinates == ("x", "y")


@pytest.mark.parametrize(
    ("force", "odd"),
    [
        (lambda x, c: c * x**3, True),
        (lambda x, c: c * x**2, False),
        (lambda x, c: c * x * np.e ** (-(x**2)), True),
        (lambda x, c: c * x + 1e-3, False),
    ],
)
def test_symmetry_is_decided_for_any_expression(x, c, force, odd):
    assert System("s", [x], [c], [x.ddot + x + force(x, c)]).odd is odd


def test_one_sided_stop_is_not_odd(x):
    stop = Element("stop", hb.model.Tabulated((0.0, 1.0, 2.0), (0.0, 0.0, 5.0)), x)
    assert not System("s", [x], [], [x.ddot + x + stop], [stop]).odd


def test_values_are_replaced_in_a_new_system(x, c):
    system = System("s", [x], [c], [x.ddot + c * x])
    other = system.with_parameters(c=3.0)
    assert (system.values["c"], other.values["c"]) == (2.0, 3.0)
    assert other.stiffness()[0, 0] == 3.0


class TestWrongInput:
    def test_unknown_parameter_with_suggestion(self, bogie):
        with pytest.raises(ModelError, match=r"unknown parameter 'Lam'\. Did you mean 'lam'\?"):
            bogie.with_parameters(Lam=0.1)

    @pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), "heavy"])
    def test_impossible_values(self, bogie, value):
        with pytest.raises(ModelError, match="Mw"):
            bogie.with_parameters(Mw=value)

    def test_number_of_equations(self, x, y):
        with pytest.raises(ModelError, match="1 equations for 2 coordinates"):
            System("s", [x, y], [], [x.ddot + y.ddot])

    def test_equation_without_coordinate(self, x, c):
        with pytest.raises(ModelError, match="contains no coordinate"):
            System("s", [x], [c], [c - 2])

    def test_unlisted_symbol(self, x, c):
        with pytest.raises(ModelError, match="equation 1 contains c"):
            System("s", [x], [], [x.ddot + c * x])

    def test_unlisted_element(self, x):
        stop = Element("stop", hb.model.DeadBand(1.0, 1.0), x)
        with pytest.raises(ModelError, match="stop"):
            System("s", [x], [], [x.ddot + x + stop])

    def test_unused_element(self, x):
        stop = Element("stop", hb.model.DeadBand(1.0, 1.0), x)
        with pytest.raises(ModelError, match="stands in no equation"):
            System("s", [x], [], [x.ddot + x], [stop])

    def test_singular_mass_matrix(self, x, y):
        with pytest.raises(ModelError, match="mass matrix is singular"):
            System("s", [x, y], [], [x.ddot + y.ddot + x, x.ddot + y.ddot + y])

    def test_coordinate_without_inertia_or_damping(self, x, y):
        with pytest.raises(ModelError, match="coordinate 'y'"):
            System("s", [x, y], [], [x.ddot + y, x.ddot + x + y])

    def test_not_a_number(self, x):
        with pytest.raises(ModelError, match="not a number"):
            System("s", [x], [], [x.ddot + float("nan") * x])

    def test_infinite_at_rest(self, x):
        with pytest.raises(ModelError, match="finite"):
            System("s", [x], [], [x.ddot + 1 / x])

    def test_acceleration_squared(self, x):
        with pytest.raises(ModelError, match="highest derivative enters nonlinearly"):
            System("s", [x], [], [x.ddot**2 + x.ddot + x])

    def test_law_of_a_product(self, x, y):
        stop = Element("stop", hb.model.DeadBand(1.0, 1.0), x * y)
        with pytest.raises(ModelError, match="not a linear combination"):
            System("s", [x, y], [], [x.ddot + stop, y.ddot], [stop])

    def test_names_used_twice(self, x):
        with pytest.raises(ModelError, match="twice or more: x"):
            System("s", [x, Coordinate("x")], [], [x.ddot, x.ddot])

    @pytest.mark.parametrize("shape", [(2, 3), (3, 3)])
    def test_matrix_shapes(self, shape):
        with pytest.raises(ModelError, match="damping matrix has shape"):
            System.from_matrices("m", np.eye(2), np.ones(shape), np.eye(2))

    def test_direction_shape(self):
        with pytest.raises(ModelError, match="direction has shape"):
            System.from_matrices("m", np.eye(2), np.eye(2), np.eye(2), {"s": (hb.model.Cubic(1.0), [1.0])})
