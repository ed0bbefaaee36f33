"""A robust design: what is raised, and what becomes of designs under uncertain parameters, as a table and a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hbbogie.design.criteria import Quantity
from hbbogie.design.point import DesignPoint
from hbbogie.design.quantile import SampledQuantile
from hbbogie.design.robust import RobustValue, Uncertainty, predicted, predicted_below, spreads
from hbbogie.design.samples import MonteCarlo
from hbbogie.errors import ModelError
from hbbogie.reports.table import Table
from hbbogie.units import behind, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
TAIL = 0.05  # share of the random designs below the quantile that the table gives


def robust_quantity(
    where: str,
    uncertain: Uncertainty | None,
    robust: float | None,
    quantile: float | None,
    designs: int | None,
    seed: int,
    unit: str,
) -> Quantity | None:
    """Return the quantity that a robust design raises; None where none is asked for."""
    if robust is None and quantile is None:
        if designs is not None:
            raise ModelError(
                f"designs={designs} (--designs) belongs to a quantile; give one with quantile= (--quantile)."
            )
        return None
    if uncertain is None:
        raise ModelError(f"{where} has no UNCERTAIN, an Uncertainty of its parameters, which a robust design needs.")
    if quantile is None and robust is not None and designs is None:
        return RobustValue(uncertain, robust, unit)
    if quantile is None or robust is not None:
        raise ModelError("give either robust= (--robust), or quantile= (--quantile) with designs= (--designs).")
    return SampledQuantile(uncertain, quantile, designs, seed, unit)


def robust_table(
    points: dict[str, DesignPoint], uncertain: Uncertainty, drawn: dict[str, MonteCarlo], service: float | None
) -> Table:
    """Return moments of the critical values of several designs, predicted and by Monte Carlo."""
    point = next(iter(points.values()))
    unit = point.system.parameter(point.parameter).unit
    rows: list[tuple[Any, ...]] = []
    for when, point in points.items():
        found = spreads(point, uncertain)
        low = min(found, key=lambda s: s.first_order[0])
        below = predicted_below(found, service) if service is not None else (None, None)
        tails = low.first_order[0] + float(stats.norm.ppf(TAIL)) * low.first_order[1], _tail(predicted(found))
        rows.append((when, f"first order, {low.name}", *low.first_order, tails[0], below[0], None, None))
        rows.append((when, f"second order, {low.name}", *low.second_order, tails[1], below[1], None, None))
        known = drawn[when].known
        if len(known) > 1:
            same = np.min([s.predict(drawn[when].factors[~np.isnan(drawn[when].values)]) for s in found], axis=0)
            under = float((same < service).mean()) if service is not None else None
            rows.append((when, "second order, random designs", *_moments(same), under, None, None))
            share = drawn[when].probability_below(service) if service is not None else (None,) * 3
            text = f"Monte Carlo, {len(known)} designs"
            rows.append((when, text, *_moments(known), *share))
    at = f"probability below {service:g}{behind(unit)}" if service is not None else "probability"
    columns = (
        "design",
        "method",
        label("mean", unit),
        label("deviation", unit),
        label(f"{100 * TAIL:g} % quantile", unit),
        at,
    )
    failed = sum(m.failed for m in drawn.values())
    notes = (
        "Quantile and probability of the second order are those of the smallest of all quadratic approximations. From, "
        "to: the 95 % interval of Clopper and Pearson.",
        *([f"{failed} of the random designs have no value, and are left out."] if failed else []),
    )
    formats = ("", "", ".5g", ".4g", ".5g", ".4f", ".4f", ".4f")
    return Table("robust", "Under uncertainty", (*columns, "from", "to"), tuple(rows), formats, notes)


def _tail(values: Array) -> float:
    return float(np.quantile(values, TAIL))


def _moments(values: Array) -> tuple[float, float, float]:
    return float(values.mean()), float(values.std(ddof=1)), _tail(values)


def shares_of(
    points: dict[str, DesignPoint],
    uncertain: Uncertainty,
    drawn: dict[str, MonteCarlo],
    service: float | None,
    across: str,
) -> Figure:
    """Draw the share of random designs below each critical value, and what the second order predicts."""
    from hbbogie import plot

    samples = {k: m.values for k, m in drawn.items()}
    smooth = {k: predicted(spreads(p, uncertain)) for k, p in points.items()}
    return plot.figure_of(plot.shares(samples, predictions=smooth, service=service, parameter_label=across))
