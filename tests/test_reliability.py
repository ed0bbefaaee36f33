"""The bench of reliability in small: everything tried is well."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hbbogie import critical_speeds, load_problem
from hbbogie.benchmark_reliability import bit_flips, bound_over_error, kills, print_reliability, random_bogies

ALIKE = {  # 21 and 43 harmonics err by 1.1e-5 and 1.3e-5 m/s to the same side
    "Mw": 511.307305, "Mf": 2017.52355, "K1": 3619954.14, "K2": 10412688.2, "K4": 203273.887, "K6": 4041029.86,
    "D2": 40312.3724, "lam": 0.0535192809, "f11": 5570601.45,
}  # fmt: skip


def test_random_bogies_and_flipped_bits(capsys):
    rows = [*random_bogies(10, 0.3, seed=1), bit_flips(30, seed=1)]
    assert [row.tried for row in rows[:2]] == [10, 1] and rows[-1].tried == 30
    assert all(row.well == row.tried for row in rows)
    print_reliability(rows)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5 and "flipped bits in a store: none read silently" in lines[-1]


def test_a_bound_holds_where_the_errors_of_two_numbers_of_harmonics_are_alike():
    bogie = load_problem("yang1995").bogie(**ALIKE)
    (fold,) = (c for c in critical_speeds(bogie, "V", (120.0, 160.0), method="mhb") if c.kind == "fold")
    ratio = bound_over_error(bogie, fold)
    assert ratio is not None and 1 <= ratio <= 20


@pytest.mark.slow
def test_a_killed_study():
    row = kills(1)
    assert (row.tried, row.well) == (1, 1)


@pytest.mark.parametrize("args", [("reliabilty",), ("reliability", "--count", "0"), ("reliability", "--count", "x")])
def test_what_cannot_be_asked(args):
    run = subprocess.run(
        [sys.executable, "-m", "hbbogie.benchmark", *args], capture_output=True, text=True, timeout=60, check=False
    )
    assert run.returncode == 2 and "Traceback" not in run.stderr and "error:" in run.stderr
