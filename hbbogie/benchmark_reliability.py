"""The bench of reliability: ``python -m hbbogie.benchmark reliability --count 200`` prints how often all was well.

Random bogies are answered in batches and one by one, and the two are compared; bounds of errors are compared with the
errors; bits of a study's store are flipped; a running study is killed and resumed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hbbogie import System, critical_speeds, critical_speeds_of, load_problem, sweep
from hbbogie.critical.harmonic_error import bound_by_harmonics
from hbbogie.errors import ModelError
from hbbogie.exact.critical import fold_near
from hbbogie.results import Critical
from hbbogie.results.failure import FAILURES
from hbbogie.studies.dataset import dataset_of
from hbbogie.studies.store import Store

VARIED = ("Mw", "Mf", "K1", "K2", "K4", "K6", "D2", "lam", "f11")
SPAN = (10.0, 250.0)  # m/s
ROUND_OFF = 1e-9  # relative difference of two exact values
PAGE = 4096  # bytes of a page of SQLite
PATIENCE = 120.0  # s for a study to finish some points
STUDY = """problem = "bautin"
job = "critical"
[options]
interval = [-2.0, 0.5]
[points]
sample = "grid"
[points.parameters]
a = { low = 0.5, high = 1.5, count = 24 }
"""


@dataclass(frozen=True)
class Row:
    """What was tried, how often, how often all was well, and a remark."""

    what: str
    tried: int
    well: int
    remark: str


def measure_reliability(count: int, seed: int = 0) -> list[Row]:
    """Try everything; ``count`` bogies in batches and bit flips, a tenth of it one by one, a hundredth of kills."""
    rows: list[Row] = []
    for share in (0.2, 0.5):
        rows += random_bogies(count, share, seed)
    rows.append(bit_flips(count, seed))
    rows.append(kills(max(1, count // 100)))
    return rows


def random_bogies(count: int, share: float, seed: int = 0) -> list[Row]:
    """Return how random bogies are answered, in batches and one by one, and how good the bounds of errors are."""
    system, rng = load_problem("yang1995").bogie(), np.random.default_rng(seed)
    designs = {n: system.values[n] * (1 + share * rng.uniform(-1, 1, count)) for n in VARIED}
    start = time.process_time()
    found = critical_speeds_of(system, designs, interval=SPAN)
    each = 1e3 * (time.process_time() - start) / count
    name, folds = f"bogies +-{100 * share:.0f} %", int(np.isfinite(found.fold).sum())
    answered = int((~found.failed).sum())
    text = f"{folds} folds, {int(found.complete.sum())} with all branches followed, {each:.1f} ms each"
    rows, tally, ratios = [Row(f"{name}, in batches: answered", count, answered, text)], _Tally(), list[float]()
    for d in range(max(1, count // 10)):
        one = system.with_parameters(**{n: float(column[d]) for n, column in designs.items()})
        found_here = critical_speeds(one, "V", SPAN, method="mhb")
        tally.add(float(found.critical[d]), found_here[0] if found_here else None, found_here.complete)
        ratios += [r for c in found_here if c.kind == "fold" and (r := bound_over_error(one, c)) is not None]
    unsafe = f"too high by the batch {tally.batch_high}, by harmonic balance {tally.other_high}"
    rows.append(Row(f"{name}, one by one: the same", tally.tried, tally.same, f"{unsafe}, not complete {tally.open}"))
    held = sum(r >= 1 for r in ratios)
    middle = f"bound / error: median {np.median(ratios):.3g}" if ratios else "no folds"
    return [*rows, Row(f"{name}: bound by more harmonics holds", len(ratios), held, middle)]


@dataclass
class _Tally:
    """How the smallest critical values found by two methods compare."""

    tried: int = 0
    same: int = 0
    batch_high: int = 0
    other_high: int = 0
    open: int = 0

    def add(self, batch: float, other: Critical | None, complete: bool) -> None:
        self.tried += 1
        self.open += not complete
        if other is None:
            self.same += bool(np.isnan(batch))
            return
        bound = np.nan_to_num(other.error, posinf=np.inf) if other.kind == "fold" else 0.0
        slack = bound + ROUND_OFF * abs(other.value)
        self.same += bool(abs(batch - other.value) <= slack)
        self.batch_high += bool(batch > other.value + slack)
        self.other_high += bool(other.value > batch + slack)


def bound_over_error(system: System, fold: Critical, harmonics: int = 21) -> float | None:
    """Return the bound by more harmonics over the true error; None where one of both is not known."""
    bound = bound_by_harmonics(system, fold, harmonics)
    try:
        exact = fold_near(system, fold.orbit, fold.parameter).value
    except FAILURES:
        return None
    return None if bound is None else (bound[0] + 1e-10 * fold.value) / max(abs(fold.value - exact), 1e-300)


def bit_flips(count: int, seed: int = 0) -> Row:
    """Return in how many cases a flipped bit in the store of a study changes nothing, is named, or is refused."""
    rng, tally = np.random.default_rng(seed), {"unseen": 0, "named": 0, "refused": 0}
    with tempfile.TemporaryDirectory() as folder:
        store, flipped = Path(folder) / "whole.db", Path(folder) / "flipped.db"
        points = {"a": list(np.linspace(0.5, 1.5, 64))}
        truth = sweep(_squares, points, problem="bautin", store=store, workers=0)
        whole = store.read_bytes()
        pages = [i for i in range(0, len(whole), PAGE) if any(whole[i : i + PAGE])]
        for _ in range(count):
            content = bytearray(whole)
            content[int(rng.choice(pages)) + int(rng.integers(PAGE))] ^= 1 << int(rng.integers(8))
            flipped.write_bytes(content)
            try:
                with closing(Store.read(flipped)) as keep:
                    data = dataset_of(keep)
            except ModelError:
                tally["refused"] += 1
                continue
            except Exception as error:
                print(f"a flipped bit led to {type(error).__name__}: {error}", file=sys.stderr)
                continue
            if json.loads(data.attrs["damaged"]):
                kept = ~data["failed"].values
                right = not kept.any() or data["square"].values[kept].tolist() == truth["square"].values[kept].tolist()
                tally["named"] += right
            else:
                tally["unseen"] += data.equals(truth) and data.attrs == truth.attrs
    text = f"{tally['unseen']} change nothing, {tally['named']} rows named, {tally['refused']} refused in a sentence"
    return Row("flipped bits in a store: none read silently", count, sum(tally.values()), text)


def _squares(system: System) -> dict[str, float]:
    """Return something that is easy to check."""
    return {"square": system.values["a"] ** 2}


def kills(count: int) -> Row:
    """Return how often a study that was killed could be resumed with what it had finished, to the right end."""
    well, kept = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        file, store = Path(folder) / "study.toml", Path(folder) / "study.db"
        file.write_text(STUDY)
        command = [sys.executable, "-m", "hbbogie", "study", "run", str(file), "--store", str(store), "--workers", "1"]
        for _ in range(count):
            for part in Path(folder).glob("study.db*"):
                part.unlink()
            with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
                end = time.monotonic() + PATIENCE
                while _finished(store) < 3 and process.poll() is None and time.monotonic() < end:
                    time.sleep(0.02)
                process.kill()
            before = _times(store)
            subprocess.run([*command, "--resume"], capture_output=True, check=False)
            after = _times(store)
            with closing(Store.read(store)) as keep:
                data = dataset_of(keep)
            right = len(after) == 24 and np.allclose(data["fold"].values, -(data["a"].values ** 2) / 4, rtol=1e-6)
            well += bool(right and all(after.get(point) == when for point, when in before.items()))
            kept += len(before)
    return Row("studies killed and resumed: all as it should be", count, well, f"{kept / count:.1f} of 24 points kept")


def _times(store: Path) -> dict[int, str]:
    """Return when each finished point was finished."""
    try:
        with closing(Store.read(store)) as keep:
            return {o.point: when for o, _, when in keep.outcomes() if o.point >= 0}
    except ModelError:  # not there yet
        return {}


def _finished(store: Path) -> int:
    return len(_times(store))


def print_reliability(rows: list[Row]) -> None:
    """Print the figures as a table."""
    width = max(len(row.what) for row in rows)
    print(f"{'':<{width}}  {'tried':>6}  {'well':>6}")
    for row in rows:
        print(f"{row.what:<{width}}  {row.tried:6d}  {row.well:6d}  {row.remark}")
