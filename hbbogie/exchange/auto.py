"""Files with which AUTO-07p follows the branch of a cycle: equations with derivatives, constants, starting orbit.

AUTO-07p: E. J. Doedel, B. E. Oldeman and others, "AUTO-07P: Continuation and bifurcation software for ordinary
differential equations", Concordia University, Montreal, 2007 and later.
"""

from __future__ import annotations

import re
from typing import Any

import casadi as ca
import numpy as np

from hbbogie.errors import ModelError, door
from hbbogie.exchange.fortran import number, statements
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results import Orbit

PERIOD = 11  # PAR(11) is the period; 10 to 14 have a meaning of their own
RESERVED = range(10, 15)
SAMPLES = 400  # of the starting orbit
NONE = "\n".join(f"subroutine {name}\nend subroutine {name}\n" for name in ("bcnd", "icnd", "fopt", "pvls"))


@door(system=System, orbit=Orbit)
def to_auto(
    system: System, orbit: Orbit, parameter: str, interval: tuple[float, float], *, intervals: int = 60
) -> dict[str, str]:
    """Return the files with which AUTO-07p follows the branch of a cycle.

    The first-order form of the equations is written with its exact derivatives in state and parameters. A kink of a
    piecewise-linear law stays one. AUTO's mesh does not know it, which limits the accuracy there.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle, from which AUTO starts. Its parameter values are those of the branch.
    parameter : str
        Parameter to vary.
    interval : tuple of float, [its unit]
        AUTO stops where the parameter leaves it.
    intervals : int
        Mesh intervals (NTST), each with four collocation points.

    Returns
    -------
    dict of str
        By file name: the equations (``NAME.f90``), the constants (``c.NAME``), the orbit (``NAME.dat``) and a script
        (``NAME.auto``), which follows the branch both ways; run it by ``auto NAME.auto``.

    Raises
    ------
    ModelError
        When the orbit is no cycle of the system, or the parameter or the interval make no sense.

    Examples
    --------
    >>> from hbbogie import find_cycles, load_problem
    >>> oscillator = load_problem("van_der_pol").van_der_pol(mu=1.0)
    >>> files = to_auto(oscillator, find_cycles(oscillator)[0], "mu", (0.1, 5.0))
    >>> list(files)
    ['van_der_pol.f90', 'c.van_der_pol', 'van_der_pol.dat', 'van_der_pol.auto']
    """
    low, high = check_interval(system, parameter, interval)
    if not orbit.H or orbit.coordinates != system.coordinate_names:
        raise ModelError(f"to_auto: {orbit.system!r} gave no cycle of {system.name!r}; give a cycle to start from.")
    name = re.sub(r"\W+", "_", system.name).strip("_").lower() or "system"
    names = system.parameter_names
    free = (k for k in range(1, len(names) + 1 + len(RESERVED)) if k not in RESERVED)
    places = dict(zip(names, free, strict=False))
    states = _states(system, orbit)
    script = f"both = run('{name}') + run('{name}', DS='-')\nsave(both, '{name}')\n"
    table = "\n".join(" ".join(f"{x: .16e}" for x in row) for row in states)
    return {
        f"{name}.f90": _equations(system, orbit, places),
        f"c.{name}": _constants(system, orbit, name, parameter, (low, high), places, states, intervals),
        f"{name}.dat": table + "\n",
        f"{name}.auto": script,
    }


def _states(system: System, orbit: Orbit) -> Any:
    """Return time [s] and states over one period, shape (SAMPLES + 1, 1 + n_states)."""
    t = np.linspace(0.0, orbit.period, SAMPLES + 1)
    return np.column_stack([t, orbit.q(t), orbit.v(t)[:, list(system.second_order)]])


def _equations(system: System, orbit: Orbit, places: dict[str, int]) -> str:
    """Return the Fortran file."""
    n, x, p = system.n_states, ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(places))
    f = system.ode.expand()(x, p)
    u = [f"U({i + 1})" for i in range(n)]
    par = [f"PAR({k})" for k in places.values()]
    rates = [[f"F({i + 1})"] for i in range(n)]
    by_state = [[f"DFDU({i + 1},{j + 1})" for j in range(n)] for i in range(n)]
    by_parameter = [[f"DFDP({i + 1},{k})" for k in places.values()] for i in range(n)]
    blocks, size = [], 1
    for outputs, called in (
        ([ca.densify(f)], [rates]),
        ([ca.jacobian(f, x)], [by_state]),
        ([ca.jacobian(f, p)], [by_parameter]),
    ):
        lines, used = statements(ca.Function("f", [x, p], ca.cse(outputs)), [u, par], called)
        blocks.append("".join(f"  {line}\n" for line in lines))
        size = max(size, used)
    values = "".join(f"  PAR({k}) = {number(orbit.parameters[name])}  ! {name}\n" for name, k in places.items())
    kept = "".join(f"!   U({i + 1}) = {state}\n" for i, state in enumerate(_state_names(system)))
    return f"""! {system.name}: {system.description or "equations of motion"}
! The states are
{kept}
subroutine func(ndim, U, icp, PAR, ijac, F, DFDU, DFDP)
  implicit none
  integer, intent(in) :: ndim, icp(*), ijac
  double precision, intent(in) :: U(ndim), PAR(*)
  double precision, intent(out) :: F(ndim)
  double precision, intent(inout) :: DFDU(ndim, ndim), DFDP(ndim, *)
  double precision :: W({size})

{blocks[0]}
  if (ijac == 0) return
  DFDU = 0d0
{blocks[1]}
  if (ijac == 1) return
  DFDP(:, 1:{max(places.values())}) = 0d0
{blocks[2]}end subroutine func

subroutine stpnt(ndim, U, PAR, t)
  implicit none
  integer, intent(in) :: ndim
  double precision, intent(inout) :: U(ndim), PAR(*)
  double precision, intent(in) :: t

{values}end subroutine stpnt

{NONE}"""


def _state_names(system: System) -> list[str]:
    names = system.coordinate_names
    return [*names, *(f"{name}_dot" for name, second in zip(names, system.second_order, strict=True) if second)]


def _constants(
    system: System,
    orbit: Orbit,
    name: str,
    parameter: str,
    interval: tuple[float, float],
    places: dict[str, int],
    states: Any,
    intervals: int,
) -> str:
    """Return AUTO's constants; its arclength measures each state, and the parameter, relative to its size."""
    size = np.abs(states[:, 1:]).max(axis=0)
    weights = {i + 1: float(f"{1 / s:.3g}") for i, s in enumerate(size) if s > 0}
    own = abs(orbit.parameters[parameter]) or max(map(abs, interval))
    listed = {k: name for name, k in places.items()} | {PERIOD: "period"}
    return f"""dat = '{name}'
unames = {dict(enumerate(_state_names(system), 1))}
parnames = {listed}
NDIM = {system.n_states}, IPS = 2, IRS = 0, ILP = 1
ICP = ['{parameter}', 'period']
NTST = {intervals}, NCOL = 4, IAD = 3, ISP = 2, ISW = 1, IPLT = 0, NBC = 0, NINT = 0
NMX = 300, NPR = 1000, MXBF = 0, IID = 2, ITMX = 9, ITNW = 7, NWTN = 3, JAC = 1
EPSL = 1e-09, EPSU = 1e-09, EPSS = 1e-05
DS = 0.02, DSMIN = 1e-06, DSMAX = 0.3, IADS = 1
NPAR = {max(*places.values(), 36)}, THL = {{'{parameter}': {1 / own:.3g}, 'period': 0.0}}, THU = {weights}
UZSTOP = {{'{parameter}': [{interval[0]!r}, {interval[1]!r}]}}
"""
