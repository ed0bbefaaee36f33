"""The bench of reliability in small: everything tried is well."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hbbogie.benchmark_reliability import bit_flips, kills, print_reliability, random_bogies


def test_random_bogies_and_flipped_bits(capsys):
    rows = [*random_bogies(10, 0.3, seed=1), bit_flips(30, seed=1)]
    assert [row.tried for row in rows[:2]] == [10, 1] and rows[-1].tried == 30
    assert all(row.well == row.tried for row in rows)
    print_reliability(rows)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5 and "flipped bits in a store: none read silently" in lines[-1]


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
