"""The creep coefficients of Yang's bogie, which the paper does not print, from the cycles that it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie import HarmonicBalance, ModelError, System
from hbbogie.design import Identification, Parametrisation, identify
from hbbogie.errors import unknown_name
from hbbogie.progress import Progress
from hbbogie.reports import Report, Table

from .bogie import TABLE_1

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FREE = ("f11", "f22", "f23")
LOOSE = (4, 5, 6, 12)  # states at which the paper's optimiser stopped farthest from compatibility
# half a digit of V (0.005 m/s) is ten times below the scatter of the rows about any fit, hence 0.05 m/s
SIGMA = {"V": 0.05, "omega": 0.005, "q1": 0.0, "q3": 5e-5}
BELOW_CONTACT = 0.004  # m; amplitude of the row of the Hopf point, any below the clearance
SHEAR_MODULUS = 80.8e9  # Pa
KALKER = {"C11": 4.54, "C22": 4.21, "C23": 1.95, "C33": 0.965}  # nu = 1/4, ratio of semi-axes b/a = 0.7


def kalker(Gab: Any) -> dict[str, Any]:
    """Return the creep coefficients by Kalker's linear theory from G a b [N], the one number left open."""
    area = Gab / SHEAR_MODULUS
    return {
        "f11": KALKER["C11"] * Gab,
        "f22": KALKER["C22"] * Gab,
        "f23": KALKER["C23"] * SHEAR_MODULUS * area**1.5,
        "f33": KALKER["C33"] * SHEAR_MODULUS * area**2,
    }


def identification(
    system: System,
    progress: Progress,
    free: Sequence[str] | None = None,
    theory: str | None = None,
    robust: bool = False,
) -> Report:
    """Fit the creep coefficients to Table 1: free ones, and Kalker's theory with one parameter.

    Parameters
    ----------
    system : System
    progress : callable
    free : sequence of str, optional
        Parameters to identify; f11, f22, f23 where left out. A system built with gravity=True has the share
        ``kg`` of the gravity stiffness among them.
    theory : {"kalker"}, optional
        Only this fit; without it both are made.
    robust : bool
        Use all rows and take weight from those far from the others, instead of leaving out the loose ones.
    """
    if theory not in (None, "kalker"):
        raise ModelError(f"identification: {unknown_name('theory', str(theory), ('kalker',))}")
    rows = _rows()
    equations = HarmonicBalance(1).equations(system)
    exclude = [] if robust else [i for i, s in enumerate(TABLE_1) if s.state in LOOSE]
    fits: dict[str, Identification] = {}
    options: dict[str, Any] = {"sigma": SIGMA, "exclude": exclude, "robust": robust}
    if theory is None:
        progress("free coefficients", 0.1)
        fits["free"] = identify(equations, rows, tuple(free or FREE), **options)
    if free is None:
        progress("Kalker's theory with one parameter", 0.5)
        fits["Kalker"] = identify(equations, rows, Parametrisation({"Gab": 2.2e6}, kalker), **options)
    tables = [_estimates(system, fits), *(_misfit(name, fit) for name, fit in fits.items())]
    tables += [_correlation(name, fit) for name, fit in fits.items() if len(fit.estimates) > 1]
    figures: dict[str, Callable[[], Figure]] = {"misfit": partial(_figure, fits)}
    notes = [f"{name}: {fit.status}." for name, fit in fits.items()]
    if "Kalker" in fits:
        values = fits["Kalker"].parameters
        shown = ", ".join(f"{n} = {values[n]:.4g}" for n in ("f11", "f22", "f23", "f33"))
        notes.append(f"Kalker's theory gives {shown}; rounded, these are the defaults of the problem.")
    return Report("Creep coefficients of Yang's bogie", tuple(tables), {}, figures, tuple(notes))


def _rows() -> list[dict[str, float | None]]:
    """Return the printed states of equivalent linearisation; the first is the Hopf point."""
    return [{"V": s.V, "omega": s.omega_el, "q1": s.a1_el or BELOW_CONTACT, "q3": s.a2_el} for s in TABLE_1]


def _estimates(system: System, fits: dict[str, Identification]) -> Table:
    rows: list[tuple[Any, ...]] = []
    for name, fit in fits.items():
        for key, value in fit.estimates.items():
            unit = system.parameter(key).unit if key in system.parameter_names else "N"
            default = system.values.get(key)
            rows.append((name, key, unit, value, fit.errors[key], default, fit.sum_of_squares, fit.freedom))
    columns = ("fit", "parameter", "unit", "estimate", "standard error", "default", "sum of squares", "freedom")
    return Table("estimates", "Estimates", columns, tuple(rows), ("", "", "", ".6g", ".2g", ".6g", ".4g", "d"))


def _misfit(name: str, fit: Identification) -> Table:
    """Return the misfit row by row, with weights and outliers."""
    states = TABLE_1
    places = {q: i for i, q in enumerate(fit.quantities)}
    shown = (("V", "V [m/s]", 1.0), ("omega", "omega [rad/s]", 1.0), ("q3", "a2 [mm]", 1e3))
    rows = []
    for i, state in enumerate(states):
        entries: list[Any] = [state.state]
        for quantity, _, factor in shown:
            residual = float(fit.residuals[i, places[quantity]])
            entries.append(None if np.isnan(residual) else factor * residual)
        weights = fit.weights[i][np.isfinite(fit.residuals[i])]
        entries += [float(weights.min(initial=1.0)), "outlier" if i in fit.outliers else ""]
        rows.append(tuple(entries))
    columns = ("state", *(f"printed - computed {header}" for _, header, _ in shown), "smallest weight", "remark")
    title = f"Misfit row by row, {name}"
    return Table(f"misfit_{name.lower()}", title, columns, tuple(rows), ("d", ".4f", ".4f", ".4f", ".2f", ""))


def _correlation(name: str, fit: Identification) -> Table:
    names = list(fit.estimates)
    rows = tuple((key, *map(float, fit.correlation[i])) for i, key in enumerate(names))
    columns = ("parameter", *names)
    return Table(f"correlation_{name.lower()}", f"Correlation, {name}", columns, rows, ("", *[".3f"] * len(names)))


def _figure(fits: dict[str, Identification]) -> Figure:
    """Draw the misfit of speed, frequency and rear amplitude, printed less computed, state by state."""
    from hbbogie import plot

    figure, axes = plot.panels(1, 3, (13.0, 3.9))
    shown = (
        ("V", "misfit of V [m/s]", 1.0),
        ("omega", "misfit of omega [rad/s]", 1.0),
        ("q3", "misfit of a2 [mm]", 1e3),
    )
    states = [s.state for s in TABLE_1]
    for ax, (quantity, text, factor) in zip(axes[0], shown, strict=True):
        room = 0.0
        for (name, fit), marker in zip(fits.items(), "os", strict=False):
            residuals = factor * fit.residuals[:, fit.quantities.index(quantity)]
            room = max(room, 1.2 * float(np.nanmax(np.abs(np.delete(residuals, fit.outliers)))))
            ax.plot(states, residuals, marker, ms=5, label=name)
        # to show outliers would flatten all others: they are named above
        beyond = [f"state {states[i]}: {residuals[i]:.2f}" for i in fit.outliers if abs(residuals[i]) > room]
        if beyond:
            ax.set_title(f"beyond the axis, {name}: {', '.join(beyond)}", fontsize=8.5, loc="right")
        ax.set_ylim(-room, room)
        ax.axhline(0.0, color="#888888", lw=1.0, zorder=1)
        ax.set_xlabel("state of Table 1")
        ax.set_ylabel(text)
    return plot.one_legend(figure)
