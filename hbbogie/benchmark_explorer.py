"""The benchmark of the explorer: sliders moved in a browser."""

from __future__ import annotations

import importlib.util
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Queue
from threading import Thread
from typing import Any

import numpy as np

from hbbogie import load_problem

CHROMIUM = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --window-size=1400,1200"
)
COUNT = "Number(document.documentElement.dataset.answers || 0)"  # diagrams that the page has drawn
MOVE = (
    "const all = [...document.querySelectorAll('#parameters input[type=range]')].filter((e) => !e.disabled);"
    "const one = all[Math.floor(all.length * arguments[0])];"
    "one.value = arguments[1]; one.dispatchEvent(new Event('input', {bubbles: true}))"
)


def moved(moves: int) -> tuple[list[float], float] | None:
    """Return the times from the slider to the drawn diagram, and the processor time of a move [s]; None without them.

    Parameters
    ----------
    moves : int
        Of sliders chosen at random, to places chosen at random.
    """
    if not (shutil.which("chromium") and shutil.which("chromedriver") and importlib.util.find_spec("selenium")):
        print("explorer: not measured, for Chromium, its driver or selenium is missing", file=sys.stderr)
        return None
    from selenium.webdriver.support.ui import WebDriverWait

    from hbbogie.explorer import Session, opening, serve

    module = load_problem("yang1995")
    session = Session("yang1995", module, module.bogie(), opening(module, module.bogie()))
    addresses: Queue[str] = Queue()
    Thread(target=lambda: serve(session, 0, browser=False, ready=addresses.put), daemon=True).start()
    with _chromium() as page:
        page.get(addresses.get(timeout=30))
        wait = WebDriverWait(page, 60, poll_frequency=0.02)
        wait.until(lambda p: p.execute_script("return document.documentElement.dataset.cycles"))
        page.execute_script("performance.clearMeasures('diagram')")
        rng, busy = np.random.default_rng(0), time.process_time()
        for _ in range(moves):
            before = page.execute_script(f"return {COUNT}")
            page.execute_script(MOVE, float(rng.uniform()), int(rng.integers(250, 750)))
            wait.until(lambda p: p.execute_script(f"return {COUNT}") > before)  # noqa: B023  # called at once
        worked = (time.process_time() - busy) / moves
        passed = page.execute_script("return performance.getEntriesByName('diagram').map(e => e.duration / 1000)")
    return passed, worked


@contextmanager
def _chromium() -> Iterator[Any]:
    """Start Chromium without a window, with a new profile."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for flag in (*CHROMIUM.split(), f"--user-data-dir={folder}"):
            options.add_argument(flag)
        page = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver") or ""))
        try:
            yield page
        finally:
            page.quit()
