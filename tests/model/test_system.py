"""Systems: what symbolic analysis finds, and what wrong input is told."""

from __future__ import annotations

import copy
import inspect
import math
import pickle

import casadi as ca
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


COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
}


class TestAValue:
    """Systems and equations copy and pickle, never change, and share what is built for all parameter values."""

    @pytest.mark.parametrize("how", COPIES)
    def test_copies_of_systems_are_equal_and_independent(self, bogie, how):
        system = bogie.with_parameters(V=77.0)
        twin = COPIES[how](system)
        assert twin.values == system.values
        assert twin.coordinate_names == system.coordinate_names
        assert [c.unit for c in twin.coordinates] == [c.unit for c in system.coordinates]
        state = np.linspace(0.001, 0.01, system.n_states)
        np.testing.assert_array_equal(twin.ode(state, twin.vector()), system.ode(state, system.vector()))
        assert twin.with_parameters(V=88.0).values["V"] == 88.0 and system.values["V"] == 77.0

    @pytest.mark.parametrize("how", COPIES)
    def test_copies_of_equations_are_equal(self, balance, branch, how):
        twin, p = COPIES[how](balance), balance.system.vector(**branch.orbits[0].parameters)
        z = balance.encode(branch.orbits[0])
        np.testing.assert_array_equal(twin.encode(branch.orbits[0]), z)
        for one, other in zip(twin.derivatives((0,))(z, p), balance.derivatives((0,))(z, p), strict=True):
            np.testing.assert_array_equal(one, other)

    @pytest.mark.parametrize("how", ["deepcopy", "pickle"])
    def test_deep_copies_build_for_themselves(self, balance, how):
        balance.system.once("mark", lambda: 1)
        balance.once("mark", lambda: 1)
        twin = COPIES[how](balance)
        assert twin.once("mark", lambda: 2) == twin.system.once("mark", lambda: 2) == 2
        assert balance.once("mark", lambda: 3) == balance.system.once("mark", lambda: 3) == 1

    def test_functions_are_built_once_for_all_parameter_values(self, bogie):
        other = bogie.with_parameters(V=77.0)
        assert bogie.ode_jacobian is other.ode_jacobian
        assert bogie.parts(contact=True) is other.parts(contact=True)

    def test_values_cannot_be_changed(self, x, c):
        system = System("s", [x], [c], [x.ddot + c * x])
        changes = [
            lambda values: values.__setitem__("c", 3.0),
            lambda values: values.__delitem__("c"),
            lambda values: values.update(c=3.0),
            lambda values: values.pop("c"),
            lambda values: values.clear(),
            lambda values: values.__ior__({"c": 3.0}),
        ]
        for change in changes:
            with pytest.raises(TypeError, match="with_parameters"):
                change(system.values)
        for name in ("values", "name", "coordinates", "elements", "residual_with_forces"):
            with pytest.raises(AttributeError):
                setattr(system, name, {})
        for own in (copy.copy(system.values), copy.deepcopy(system.values), system.values.copy(), dict(system.values)):
            own["c"] = 3.0
        assert pickle.loads(pickle.dumps(system.values)) == system.values == {"c": 2.0}

    def test_a_backward_motion_undoes_a_forward_one(self):
        system = hb.load_problem("van_der_pol").van_der_pol(mu=0.5)
        end = hb.simulate(system, {"x": 1.0, "x'": 0.5}, 2.0, tolerance=1e-11)
        start = {"x": float(end.q[-1, 0]), "x'": -float(end.v[-1, 0])}
        back = hb.simulate(system.backwards(), start, 2.0, tolerance=1e-11)
        assert (back.q[-1, 0], -back.v[-1, 0]) == pytest.approx((1.0, 0.5), abs=1e-7)
        assert system.backwards().values == system.values

    @pytest.mark.parametrize("make", COPIES)
    def test_symbols_keep_what_they_are(self, make):
        z = COPIES[make](Coordinate("z", "m", "height", bounds=(0.0, np.inf)))
        assert (z.name, z.unit, z.description, z.bounds) == ("z", "m", "height", (0.0, np.inf))
        k = COPIES[make](Parameter("k", 2.0, "N/m", "stiffness", (0.0, 5.0)))
        assert (k.name, k.default, k.unit, k.description, k.bounds) == ("k", 2.0, "N/m", "stiffness", (0.0, 5.0))

    def test_a_copied_symbol_is_the_same_symbol(self, x):
        twin, equation = copy.deepcopy((x, x.ddot + x))
        assert System("s", [twin], [], [equation]).n == 1


def _verbs():
    """Return the public functions that take the values of parameters by name."""
    faces = [hb] + [getattr(hb, wing) for wing in ("attraction", "branches", "critical", "design", "equilibria")]
    faces += [getattr(hb, wing) for wing in ("methods", "model", "motion", "solving", "stability", "studies")]
    functions = {f for face in faces for f in map(face.__getattribute__, face.__all__) if inspect.isfunction(f)}
    by_name = {f for f in functions if any(_values(p) for p in inspect.signature(f).parameters.values())}
    return sorted(by_name | {hb.sweep, hb.optimise}, key=lambda f: f.__name__)


def _values(parameter):
    return parameter.kind is parameter.VAR_KEYWORD and parameter.annotation == "float"


class TestNames:
    def test_functions_that_take_values_by_name_are_found(self):
        found = {f.__name__ for f in _verbs()}
        assert found >= {"find_cycles", "solve", "critical_speeds", "chart", "simulate", "settle", "simulate_ramp"}

    @pytest.mark.parametrize("verb", _verbs(), ids=lambda f: f.__name__)
    def test_no_parameter_is_called_like_a_keyword(self, verb):
        for name, parameter in inspect.signature(verb).parameters.items():
            if not _values(parameter):
                with pytest.raises(ModelError, match="keyword of functions that take the values"):
                    Parameter(name, 1.0)

    @pytest.mark.parametrize("name", ["start", "method", "limit", "tolerance", "interval", "harmonics", "stability"])
    def test_reserved_names(self, name):
        with pytest.raises(ModelError, match=name):
            Parameter(name, 1.0)
        assert Coordinate(name).name == name

    @pytest.mark.parametrize("name", ["", "my param", "1a", "lambda", "a-b", 3, None, ("x",), "x'"])
    def test_names_are_identifiers(self, name):
        for kind in (Coordinate, lambda n: Parameter(n, 1.0)):
            with pytest.raises(ModelError, match=r"letters, digits and underscores"):
                kind(name)

    @pytest.mark.parametrize("name", ["self", "lam", "λ", "K2", "_k", "sigma", "rho", "beta"])
    def test_names_that_are_free(self, x, name):
        k = Parameter(name, 1.0)
        assert System("s", [x], [k], [x.ddot + k * x]).with_parameters(**{name: 2.0}).values[name] == 2.0


class TestWrongInput:
    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            (
                lambda x, c: ("s", x, [c], [x.ddot + c * x]),
                "coordinates: got .* type Coordinate; give a list",
            ),
            (lambda x, c: ("s", [x], c, [x.ddot + c * x]), "parameters: got .* type Parameter; give a list"),
            (lambda x, c: ("s", [x], [c], x.ddot + c * x), "equations: got .* give a list"),
            (lambda x, c: ("s", [x], [c], ca.vertcat(x.ddot + c * x)), "equations: got .* give a list"),
            (lambda x, c: ("s", [x], [c], None), "equations: got None"),
            (lambda x, c: ("s", [x], None, [x.ddot + x]), "parameters: got None"),
            (lambda x, c: ("s", "x", [c], [x.ddot + c * x]), "coordinates: got 'x'"),
            (lambda x, c: ("s", ["x"], [c], [x.ddot + c * x]), "coordinates: got 'x' in the list; make it with"),
            (
                lambda x, c: ("s", [c], [x], [x.ddot + c * x]),
                "coordinates: got .* type Parameter in the list",
            ),
            (lambda x, c: ("s", [x], [2.0], [x.ddot + x]), "parameters: got 2.0 in the list"),
            (
                lambda x, c: ("s", [x], [c], [x.ddot + c * x], c),
                "elements: got .* type Parameter; give a list",
            ),
            (lambda x, c: ("s", [x], [c], [x.ddot + c * x], ["stop"]), "elements: got 'stop' in the list"),
            (lambda x, c: ([x], [c], [x.ddot + c * x], []), "name of a system: got an object of type list"),
            (lambda x, c: ("", [x], [c], [x.ddot + c * x]), "name of a system: got ''"),
        ],
    )
    def test_arguments_that_are_not_lists_are_refused(self, x, c, arguments, said):
        with pytest.raises(ModelError, match=said):
            System(*arguments(x, c))

    @pytest.mark.parametrize(
        ("equation", "said"),
        [
            (lambda x: "x.ddot + x", "got 'x.ddot [+] x'.*quotes"),
            (lambda x: ca.MX.sym("y"), "casadi.MX cannot be used"),
            (lambda x: None, "got None; give a scalar expression"),
            (lambda x: lambda: x.ddot + x, "Call the function"),
            (lambda x: True, "got True.*casadi.if_else"),
            (lambda x: {"x": 1}, "object of type dict"),
            (lambda x: [x.ddot, x], "object of type list"),
            (lambda x: ca.vertcat(x.ddot, x), r"shape \(2, 1\)"),
            (lambda x: x.ddot == -x, "is a comparison"),
            (lambda x: x.ddot < x, "is a comparison"),
            (lambda x: 3.0, "contains no coordinate"),
        ],
    )
    def test_what_is_no_equation(self, x, equation, said):
        with pytest.raises(ModelError, match=f"equation 1.*{said}"):
            System("s", [x], [], [equation(x)])

    @pytest.mark.parametrize(
        "use",
        [
            lambda x, c: 1.0 if x > 0 else 0.0,
            lambda x, c: 1.0 if x - c > 0 else 0.0,
            lambda x, c: max(x, 0),
            lambda x, c: max(x - c, 0),
            lambda x, c: max(0, ca.sin(x) - x.dot),
            lambda x, c: min(c * x.dot, 1.0),
            lambda x, c: x > 0 and x.dot > 0,
            lambda x, c: 0 < x < 1,
            lambda x, c: not x,
        ],
    )
    def test_conditions_are_written_with_casadi(self, x, c, use):
        with pytest.raises(ModelError, match=r"casadi\.if_else.*casadi\.fmax"):
            use(x, c)

    @pytest.mark.parametrize(
        "use",
        [lambda x: math.tanh(x), lambda x: math.sin(x.dot - 1), lambda x: float(2 * x), lambda x: math.sqrt(abs(x))],
    )
    def test_functions_of_math_are_written_with_casadi(self, x, use):
        with pytest.raises(ModelError, match=r"casadi\.tanh\(x\) for math\.tanh\(x\)"):
            use(x)

    @pytest.mark.parametrize(
        ("use", "instead"),
        [
            (lambda x: np.tanh(x), "tanh"),
            (lambda x: np.sin(x.dot - 1), "sin"),
            (lambda x: np.abs(x), "fabs"),
            (lambda x: np.maximum(x - 1, 0), "fmax"),
            (lambda x: np.where(x > 0, x, 0), "if_else"),
            (lambda x: np.sign(2 * x), "sign"),
            (lambda x: np.arctan2(x, 1.0), "atan2"),
        ],
    )
    def test_functions_of_numpy_are_written_with_casadi(self, x, use, instead):
        with pytest.raises(ModelError, match=rf"numpy\.\w+ cannot take an expression.*casadi\.{instead}\."):
            use(x)

    def test_arithmetic_with_numbers_of_numpy_is_free(self, x, c):
        """The same equation, written with and without them."""
        factor, zero = np.float64(2.0), np.zeros(())
        rows = [
            x.ddot + factor * x + zero,
            x.ddot + (np.array([1.0, 2.0]) * x)[1],
            x.ddot + sum([x, x]),
            x.ddot + x * 2,
        ]
        for row in rows:
            assert System("s", [x], [], [row]).stiffness()[0, 0] == 2.0

    def test_constants_among_expressions_are_numbers(self, x):
        assert float(x - x) == 0.0 and not x - x and bool(x == x)

    def test_nan_of_a_math_function_is_explained(self, x):
        with pytest.raises(ModelError, match="functions of math make NaN"):
            System("s", [x], [], [x.ddot + math.tanh(ca.sin(x)) * x])

    @pytest.mark.parametrize("value", ["5", True, np.True_, None, [1.0], np.ones(1), 1j, ca.SX.sym("y")])
    def test_values_are_numbers(self, x, c, value):
        with pytest.raises(ModelError, match="'k'"):
            Parameter("k", value)
        with pytest.raises(ModelError, match="'c'"):
            System("s", [x], [c], [x.ddot + c * x]).with_parameters(c=value)

    @pytest.mark.parametrize("value", [3, np.float64(3.0), np.int64(3), np.array(3.0), ca.DM(3)])
    def test_numbers_of_any_kind(self, x, c, value):
        assert System("s", [x], [c], [x.ddot + c * x]).with_parameters(c=value).values["c"] == 3.0

    @pytest.mark.parametrize("bounds", [(1.0, 0.0), (1.0, 1.0), 3.0, None, (0, 1, 2), ("0", "1"), (np.nan, 1.0)])
    def test_bounds(self, bounds):
        for make in (lambda: Coordinate("z", bounds=bounds), lambda: Parameter("k", 1.0, bounds=bounds)):
            with pytest.raises(ModelError, match="low < high"):
                make()

    @pytest.mark.parametrize("unit", [3.0, None, (0.0, 1.0)])
    def test_units_are_texts(self, unit):
        for make in (lambda: Coordinate("z", unit), lambda: Parameter("k", 1.0, unit)):
            with pytest.raises(ModelError, match="as unit; give a text"):
                make()

    @pytest.mark.parametrize(
        ("law", "said"),
        [
            (lambda u: 1.0 if u > 0 else 0.0, r"casadi\.if_else"),
            (lambda u: max(u, 0), r"casadi\.fmax"),
            (lambda u: math.tanh(u), r"casadi\.tanh"),
            (lambda u: np.tanh(u), r"casadi\.tanh"),
            (lambda u: None, "force of element 'e': got None"),
            (lambda u: "u", "force of element 'e': got 'u'"),
        ],
    )
    def test_forces_of_laws(self, x, law, said):
        class Own:
            def force(self, u):
                return law(u)

        e = Element("e", Own(), x)
        with pytest.raises(ModelError, match=said):
            System("s", [x], [], [x.ddot + e], [e])

    @pytest.mark.parametrize("argument", ["x", None, ca.MX.sym("x"), True, lambda: 1.0])
    def test_arguments_of_elements(self, argument):
        with pytest.raises(ModelError, match="argument of element 'e'"):
            Element("e", hb.model.Cubic(1.0), argument)

    @pytest.mark.parametrize("name", ["", None, 3])
    def test_names_of_elements(self, x, name):
        with pytest.raises(ModelError, match="name of an element"):
            Element(name, hb.model.Cubic(1.0), x)

    def test_the_class_of_a_law_is_refused_as_a_law(self, x):
        with pytest.raises(ModelError, match="the class DeadBand itself"):
            Element("e", hb.model.DeadBand, x)

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
