"""Systems that several test files use, built once."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

import hbbogie as hb


@pytest.fixture(autouse=True)
def figures_closed() -> Iterator[None]:
    """Close what a test has drawn: Matplotlib warns of too many open figures, which would fail a later test."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(scope="session")
def bogie() -> hb.System:
    return hb.load_problem("yang1995").bogie()


@pytest.fixture(scope="session")
def balance(bogie: hb.System):
    return hb.HarmonicBalance(15).equations(bogie)


@pytest.fixture(scope="session")
def branch(bogie: hb.System, balance) -> hb.Branch:
    hopf = next(h for h in hb.hopf_points(bogie, "V", (60, 190)))
    return hb.trace(balance, hopf, "V", (60.0, 190.0))


@pytest.fixture(scope="session")
def cycles_at_90(bogie: hb.System) -> list[hb.Orbit]:
    return hb.find_cycles(bogie, V=90.0, method="mhb")
