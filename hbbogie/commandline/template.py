"""The problem file that `hbbogie new` writes."""

from __future__ import annotations

from pathlib import Path

from hbbogie.errors import ModelError

TEXT = '''"""A mass on a moving belt: friction that falls with the sliding speed excites a spring.

Source: (yours). The belt moves at v; the mass m hangs on a spring k with a damper c and slides at v - x\'. The
friction falls like mu(s) = mu0 (1 - a s + b s^3). Replace everything by your own: coordinates, parameters, equations.

Assumption: s > 0, the mass never overtakes the belt. It holds above v = 0.71 m/s. Below, friction would change its sign
and the mass would stick: write Friction(limit, width) of hbbogie.model there. Look at the output "sliding speed".
"""

from hbbogie import Coordinate, Output, Parameter, System


def belt(**parameters: float) -> System:
    """Return the mass on the belt; keywords replace parameter values."""
    x = Coordinate("x", "m", "displacement of the mass")

    # name, default, unit, what it is, (smallest, largest)
    v = Parameter("v", 0.75, "m/s", "speed of the belt", (0.01, 10.0))
    m = Parameter("m", 1.0, "kg", "mass", (1e-3, 1e3))
    k = Parameter("k", 1.0, "N/m", "stiffness", (1e-3, 1e6))
    c = Parameter("c", 0.05, "N s/m", "damping", (0.0, 1e3))
    N = Parameter("N", 1.0, "N", "normal force", (0.0, 1e3))
    mu0 = Parameter("mu0", 0.4, "1", "friction at no sliding speed", (0.0, 2.0))
    a = Parameter("a", 0.5, "s/m", "fall of the friction", (0.0, 10.0))
    b = Parameter("b", 0.2, "s3/m3", "rise of the friction at high speed", (0.0, 10.0))

    s = v - x.dot  # the sliding speed
    friction = N * mu0 * (1 - a * s + b * s**3)
    # one equation for each coordinate: what must be zero; x.dot and x.ddot are the derivatives.
    # Conditions are written casadi.if_else(condition, then, otherwise), functions as casadi.tanh(x), and the like.
    equations = [m * x.ddot + c * x.dot + k * x - friction]
    # what you want to know besides, by names that tables, figures and limits use
    outputs = [
        Output("sliding speed", s, "m/s", "of the mass on the belt"),
        Output("friction force", friction, "N", "of the belt on the mass"),
    ]
    known = [v, m, k, c, N, mu0, a, b]
    return System("belt", [x], known, equations, outputs=outputs).with_parameters(**parameters)


SYSTEM = belt  # what the command line builds
PARAMETER = "v"  # what it follows
RANGE = (0.72, 1.2)  # and where
'''


def write_problem(path: Path) -> Path:
    """Write the file; raise `ModelError` where it exists already or cannot be written."""
    if path.suffix != ".py" or not path.stem.isidentifier():
        raise ModelError(f"{str(path)!r}: give a file name of letters, digits and underscores that ends in .py.")
    try:
        with open(path, "x", encoding="utf-8") as file:
            file.write(TEXT)
    except FileExistsError:
        raise ModelError(f"{str(path)!r} exists already; give another name, or remove it.") from None
    except OSError as error:
        raise ModelError(f"cannot write {str(path)!r}: {error.strerror}.") from error
    return path
