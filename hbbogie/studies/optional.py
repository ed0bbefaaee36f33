"""Libraries that only studies need."""

from __future__ import annotations

import importlib
from typing import Any

from hbbogie.errors import ModelError


def required(module: str) -> Any:
    """Return an optional module; raise `ModelError` that says how to install it where it is missing."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise ModelError(f'{name} is not installed; install it with: pip install "hbbogie[studies]"') from error
