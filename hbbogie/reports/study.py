"""The results of a study as tables and figures, in a report or in one HTML file that needs no network."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hbbogie.errors import ModelError, unknown_name
from hbbogie.reports.figures import draw, drawn_or_reason, reason_of
from hbbogie.reports.report import Report
from hbbogie.reports.table import Table
from hbbogie.studies.dataset import names_of
from hbbogie.studies.statistics import Exceedance, exceedance, independent, prediction, sobol_indices, values_of
from hbbogie.studies.store_rows import listed
from hbbogie.units import behind, label

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SHOWN = 20  # failures listed
SAMPLINGS = {"lhs": "Latin hypercube", "sobol": "Sobol's sequence", "saltelli": "Saltelli's points", "list": "listed"}
NAMED = 4  # outputs in the summary
MOST = 8  # inputs of parallel coordinates where none are named


def report_of(
    data: xr.Dataset,
    title: str,
    outputs: Sequence[str] = (),
    figures: Sequence[Mapping[str, Any]] = (),
) -> Report:
    """Return tables and figures of a study.

    Parameters
    ----------
    data : xarray.Dataset
        As returned by `sweep`.
    title : str
    outputs : sequence of str
        To be summarised; all numbers but gradients where empty.
    figures : sequence of mappings
        Of each its ``kind`` ("map", "distribution", "sensitivity", "scatter", "parallel", "prediction") and the names
        it draws, as in a study file.

    Raises
    ------
    ModelError
        When no point is finished.
    """
    if data.sizes["point"] == 0:
        raise ModelError("report: no point of this study is finished.")
    chosen = [n for n in (outputs or names_of(data, "outputs")) if outputs or not n.startswith("d")]
    numeric = [n for n in chosen if n in data and data[n].dtype.kind == "f"]
    tables = [_summary(data, numeric)]
    drawn: dict[str, Callable[[], Figure]] = {}
    given = names_of(data, "outputs")
    notes = [f"outputs: {unknown_name('output', n, given)}" for n in outputs if n not in given]
    for k, figure in enumerate(figures, 1):
        try:
            more, draws = _figure(data, dict(figure), k)
        except Exception as error:  # one figure must not cost the others
            notes.append(f"Figure {k} ({figure['kind']}): {reason_of(error)}")
            continue
        tables += more
        drawn[f"{k}_{figure['kind']}"] = partial(drawn_or_reason, draws)
    if data["failed"].values.any():
        tables.append(_failures(data))
    return Report(
        title,
        (*tables, _about(data)),
        {},
        drawn,
        (*damage(data), *notes),
        {"attributes": dict(data.attrs)},
        summary=(*damage(data), *_sentences(data, numeric, tables)),
        about=(_what(data),),
        inputs=(_inputs(data),),
    )


def damage(data: xr.Dataset) -> tuple[str, ...]:
    """Return a sentence on the rows that are damaged in the store of a study; none where all are whole."""
    points = json.loads(data.attrs.get("damaged", "[]"))
    if not points:
        return ()
    return (f"Damaged in the store: {listed(points)}. Resume the study to compute these points anew.",)


def _what(data: xr.Dataset) -> str:
    """Return what the study did at how many points."""
    a, done = data.attrs, data.sizes["point"]
    problem = Path(str(a["problem"])).stem
    job = str(a["job"]).rpartition(":")[2]
    sampling = SAMPLINGS.get(str(a["sampling"]), str(a["sampling"]))
    made = f"{sampling}, seed {a['seed']}" if a["seed"] != "" else sampling
    return f"The job {job!r} of the problem {problem!r} at {done} of {a['total']} points ({made})."


def _inputs(data: xr.Dataset) -> Table:
    """Return the inputs with their units, distributions and ranges."""
    nominal, drawn = (json.loads(data.attrs.get(key, "{}")) for key in ("nominal_inputs", "drawn"))
    rows = []
    for name in names_of(data, "inputs"):
        v, own = data[name].values, data[name].attrs
        ends, about = (float(v.min()), float(v.max())), drawn.get(name, ("", None, None))
        rows.append((name, own.get("long_name", ""), own["units"] or "1", nominal[name], *ends, *about))
    columns: tuple[str, ...] = "input", "what it is", "unit", "nominal", "from", "to", "drawn from", "5 %", "95 %"
    formats: tuple[str, ...] = "", "", "", ".5g", ".5g", ".5g", "", ".5g", ".5g"
    kept = slice(None) if drawn else slice(6)
    note = "From, to: what the points reach. 5 %, 95 %: quantiles of the distribution."
    return Table("inputs", "Inputs", columns[kept], tuple(r[kept] for r in rows), formats[kept], (note,) * bool(drawn))


def _sentences(data: xr.Dataset, names: Sequence[str], tables: Sequence[Table]) -> tuple[str, ...]:
    """Return what the study found: where the outputs lie, what is below a threshold, which input matters most."""
    said, failed = [], int(data["failed"].values.sum())
    done, total = data.sizes["point"], int(data.attrs["total"])
    if done < total:
        said.append(f"Incomplete: {done} of {total} points are finished.")
    for name in names[:NAMED]:
        v, unit = data[name].values, data[name].attrs["units"]
        v, unit = v[np.isfinite(v)], behind(unit)
        if len(v):
            low, middle, high = np.quantile(v, (0.05, 0.5, 0.95))
            said.append(
                f"{name}: nine of ten points lie between {low:.4g} and {high:.4g}{unit}, the median is "
                f"{middle:.4g}{unit}."
            )
    for table in tables:
        if table.name.endswith("_exceedance"):
            for side, threshold, share, low, high, *_ in table.rows:
                what = table.title.partition(": ")[2].partition(" [")[0]
                said.append(
                    f"{what} lies {side} {threshold:g} with a probability of {100 * share:.2g} % "
                    f"({100 * low:.2g} to {100 * high:.2g} %)."
                )
        if table.name.endswith("_sensitivity") and table.rows:
            name, first, _, whole, error = max(table.rows, key=lambda row: row[3])
            of = table.title.rpartition(" ")[2]
            if not error < whole:
                said.append(f"Which input matters most for {of} is not decided: the intervals exceed the indices.")
                continue
            said.append(
                f"{name} matters most for {of}: alone it causes {100 * first:.0f} % of the variance, together with "
                f"others {100 * whole:.0f} %."
            )
    if failed:
        said.append(f"{failed} of {data.sizes['point']} points have no answer.")
    return tuple(said)


def _about(data: xr.Dataset) -> Table:
    done, failed = data.sizes["point"], int(data["failed"].values.sum())
    a, total = data.attrs, int(data.attrs["total"])
    seconds = data["seconds"].values[np.isfinite(data["seconds"].values)]
    times = f"median {np.median(seconds):.3g} s, longest {np.max(seconds):.3g} s" if len(seconds) else "unknown"
    rows = [
        ("problem", a["problem"]),
        ("job", a["job"]),
        ("options", a["options"]),
        ("values", a["values"]),
        (
            "points",
            f"{done} of {total} finished, {failed} without an answer ({100 * (1 - failed / done):.2f} % answered)",
        ),
        ("sampling", f"{a['sampling']}, seed {a['seed']}" if a["seed"] != "" else a["sampling"]),
        ("inputs", ", ".join(names_of(data, "inputs"))),
        ("time per point", times),
        ("versions", ", ".join(f"{n} {v}" for n, v in json.loads(a["versions"]).items())),
        ("hash", f"problem {a['problem_hash']}, job {a['job_hash']}"),
        *_changes(data),
    ]
    return Table("about", "The study", ("what", "value"), tuple(rows), ("", ""))


def _changes(data: xr.Dataset) -> list[tuple[str, str]]:
    """Return what was changed meanwhile, and how many of the points are older than that."""
    finished = data["finished"].values
    found = []
    for change in json.loads(data.attrs.get("changes", "[]")):
        older = int((finished < change["accepted"]).sum())
        found.append(
            (f"changed {change['accepted']}", f"from {'; '.join(change['what'])}; {older} of the points are older")
        )
    return found


def _summary(data: xr.Dataset, names: Sequence[str]) -> Table:
    columns = ("output", "values", "mean", "deviation", "smallest", "5 %", "median", "95 %", "largest")
    nominal = json.loads(data.attrs["nominal_outputs"])
    rows = []
    notes = [
        "Nominal: at the problem's own values of the inputs. Points without a value, such as a fold, are left out."
    ]
    for name in names:
        v = data[name].values
        text = label(name, data[name].attrs["units"])
        if infinite := int(np.isinf(v).sum()):
            notes.append(f"{name}: {infinite} infinite value{'s' * (infinite != 1)}, left out here.")
        v = v[np.isfinite(v)]
        if not len(v):
            rows.append((text, 0, *[None] * 7, nominal.get(name)))
            continue
        quantiles = (float(q) for q in np.quantile(v, (0, 0.05, 0.5, 0.95, 1)))
        rows.append((text, len(v), float(v.mean()), float(v.std()), *quantiles, nominal.get(name)))
    formats = ("", "d", *[".6g"] * 8)
    return Table("summary", "Outputs", (*columns, "nominal"), tuple(rows), formats, tuple(notes))


def _failures(data: xr.Dataset) -> Table:
    places = np.flatnonzero(data["failed"].values)
    inputs = names_of(data, "inputs")[:6]
    rows = [(int(data["point"].values[i]), *(float(data[n].values[i]) for n in inputs)) for i in places[:SHOWN]]
    notes = [f"Point {data['point'].values[i]}: {data['status'].values[i]}" for i in places[:SHOWN]]
    if len(places) > SHOWN:
        notes.append(f"{len(places)} in all.")
    formats = ("d", *[".5g"] * len(inputs))
    return Table("failures", "Points without an answer", ("point", *inputs), tuple(rows), formats, tuple(notes))


def _figure(data: xr.Dataset, figure: dict[str, Any], k: int) -> tuple[list[Table], Callable[[], Figure]]:
    """Return the tables that belong to a figure, and the function that draws it."""
    kind = figure["kind"]
    for key in ("output", "x", "y", "colour"):
        if key in figure:
            values_of(data, figure[key])  # raises where there is none of that name
    if kind == "map":
        if np.count_nonzero(np.isfinite(values_of(data, figure["output"]))) < 3:
            raise ModelError(f"fewer than three points have a value of {figure['output']!r}.")
        return [], partial(draw, "parameter_map", data, figure["x"], figure["y"], figure["output"])
    if kind == "scatter":
        return [], partial(draw, "sample_scatter", data, figure["x"], figure["y"], figure.get("colour"))
    if kind == "parallel":
        inputs = figure.get("inputs") or _most_correlated(data, figure["output"])
        return [], partial(draw, "parallel_coordinates", data, inputs, figure["output"])
    return {"prediction": _predicted, "sensitivity": _sensitivity, "distribution": _distribution}[kind](data, figure, k)


def _predicted(data: xr.Dataset, figure: dict[str, Any], k: int) -> tuple[list[Table], Callable[[], Figure]]:
    p, text = prediction(data, figure["output"]), label(figure["output"], data[figure["output"]].attrs["units"])
    rows: tuple[tuple[Any, ...], ...] = (
        ("nominal value", p.nominal),
        ("root mean square error", p.rms),
        ("largest error", p.worst),
        ("share of the variance explained [1]", p.explained),
    )
    title = f"Gradient at the nominal point against samples: {text}"
    table = Table(f"{k}_prediction", title, ("what", "value"), rows, ("", ".5g"))
    return [table], partial(draw, "prediction", p.sampled, p.predicted, text)


def _sensitivity(data: xr.Dataset, figure: dict[str, Any], k: int) -> tuple[list[Table], Callable[[], Figure]]:
    found = sobol_indices(data, figure["output"])
    parts = found.first, found.first_error, found.total, found.total_error
    rows = tuple((n, *map(float, v)) for n, *v in zip(found.names, *parts, strict=True))
    left_out = f"{found.dropped} left out because a point of theirs has no finite value"
    note = f"{found.used} base points; {left_out}. Errors: 95 %."
    if found.unsettled:
        note += (
            f" Too few points to tell: of {', '.join(found.unsettled)} the interval is larger than the index; four "
            "times as many halve it."
        )
    columns = ("input", "first order [1]", "+- first", "total [1]", "+- total")
    title = f"Sobol indices of {figure['output']}"
    table = Table(f"{k}_sensitivity", title, columns, rows, ("", *[".4f"] * 4), (note,))
    bars = found.names, found.first, found.total, found.first_error, found.total_error
    return [table], partial(draw, "sensitivity", *bars)


def _distribution(data: xr.Dataset, figure: dict[str, Any], k: int) -> tuple[list[Table], Callable[[], Figure]]:
    output = figure["output"]
    values, text = values_of(data, output)[independent(data)], label(output, data[output].attrs["units"])
    lines = [exceedance(values, t, above) for above in (False, True) for t in _thresholds(figure, above)]
    rows = tuple(
        ("above" if e.above else "below", e.threshold, e.probability, e.low, e.high, e.count, e.total) for e in lines
    )
    columns = ("side", f"threshold {text}", "probability [1]", "95 % from", "95 % to", "points", "of")
    formats = ("", ".6g", *[".5f"] * 3, "d", "d")
    tables = [Table(f"{k}_exceedance", f"Probabilities: {text}", columns, rows, formats)] if rows else []
    return tables, partial(
        draw, "distribution", data.isel(point=independent(data)), output, [(e.threshold, _sentence(e)) for e in lines]
    )


def _thresholds(figure: Mapping[str, Any], above: bool) -> list[float]:
    given = figure.get("above" if above else "below", [])
    return [float(t) for t in (given if isinstance(given, list) else [given])]


def _sentence(e: Exceedance) -> str:
    side = "above" if e.above else "below"
    return f"{100 * e.probability:.3g} % {side} {e.threshold:g} ({100 * e.low:.3g} to {100 * e.high:.3g} %)"


def _most_correlated(data: xr.Dataset, output: str) -> list[str]:
    """Return the inputs that go with an output most closely, by Spearman's rank correlation."""
    from scipy.stats import spearmanr

    w = values_of(data, output)
    known = np.isfinite(w)
    size = {}
    for name in names_of(data, "inputs"):
        u = data[name].values[known]
        vary = known.sum() > 2 and np.ptp(u) > 0 and np.ptp(w[known]) > 0
        size[name] = abs(float(spearmanr(u, w[known]).statistic)) if vary else 0.0
    return sorted(size, key=lambda n: -size[n])[:MOST]
