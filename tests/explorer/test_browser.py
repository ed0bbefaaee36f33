"""The explorer in a real browser without a window: Chromium with its driver, where both are installed."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import pytest

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is part of the extra 'test'")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    not (CHROMIUM and DRIVER),
    reason="no browser: Chromium and its driver (Debian: chromium, chromium-driver) are missing",
)
FLAGS = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --window-size=1400,1300"
)
WAIT = 30.0  # s


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    from selenium.webdriver.chrome.service import Service

    command = [sys.executable, "-m", "hbbogie", "explore", "yang1995", "--no-browser", "--port", "0"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in [*FLAGS.split(), f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"]:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        browser.get(re.search(r"http://\S+", server.stdout.readline())[0])
        _until(browser, "return document.documentElement.dataset.cycles")
        yield browser
        assert [
            entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE" and "422" not in str(entry)
        ] == []
    finally:
        browser.quit()
        server.terminate()
        server.communicate()


def _until(browser, script, *args):
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, WAIT, poll_frequency=0.05).until(lambda b: b.execute_script(script, *args))


def _text(browser, place):
    return browser.execute_script("return document.querySelector(arguments[0]).textContent", place)


def _answers(browser):
    return browser.execute_script("return Number(document.documentElement.dataset.answers)")


def _slide(browser, name, share):
    before = _answers(browser)
    script = (
        "const s = document.querySelector(`#parameter-${arguments[0]} input[type=range]`);"
        "s.value = 1000 * arguments[1]; s.dispatchEvent(new Event('input', {bubbles: true}))"
    )
    browser.execute_script(script, name, share)
    _until(browser, "return Number(document.documentElement.dataset.answers) > arguments[0]", before)


def _type(browser, name, text):
    before = _answers(browser)
    script = (
        "const f = document.querySelector(`#parameter-${arguments[0]} input[type=text]`);"
        "f.value = arguments[1]; f.dispatchEvent(new Event('change', {bubbles: true}))"
    )
    browser.execute_script(script, name, text)
    _until(browser, "return Number(document.documentElement.dataset.answers) > arguments[0]", before)


def _reset(browser):
    before = _answers(browser)
    browser.find_element("id", "reset").click()
    _until(browser, "return Number(document.documentElement.dataset.answers) > arguments[0]", before)


def test_the_page_loads(page):
    assert _text(page, "#system") == "Yang's bogie"
    assert "fold88.764 m/s" in _text(page, "#facts") and "Hopf point90.974 m/s" in _text(page, "#facts")
    kinds = page.execute_script(
        "return [...document.querySelectorAll('#diagram path.curve')].map(e => e.classList.value)"
    )
    assert {"curve unstable", "curve stable", "curve rest stable", "curve rest unstable"} <= set(kinds)
    assert "speed V [m/s]" in _text(page, "#diagram") and "[mm]" in _text(page, "#diagram")


def test_a_slider_moves_the_diagram(page):
    """Each half of the stiffness to either side of its value moves the fold, and a pinned diagram stays."""
    before = page.execute_script("return document.querySelector('#diagram path.curve.stable').getAttribute('d')")
    page.find_element("id", "pin").click()
    _slide(page, "K2", 0.7)
    assert page.execute_script("return document.querySelectorAll('#diagram .pinned path.curve').length") >= 4
    assert "fold91.471 m/s+2.71 from the pinned" in _text(page, "#facts")
    page.find_element("id", "pin").click()
    now = page.execute_script("return document.querySelector('#diagram path.curve.stable').getAttribute('d')")
    assert now != before
    _reset(page)
    assert "fold88.764 m/s" in _text(page, "#facts")


def test_a_click_on_a_branch_shows_the_cycle(page):
    from selenium.webdriver.common.action_chains import ActionChains

    before = page.execute_script("return Number(document.documentElement.dataset.cycles)")
    script = (  # the middle of the last curve drawn in the upper layer, on the screen
        "const c = [...document.querySelectorAll('#diagram path.curve.stable:not(.rest)')].pop();"
        "const p = c.getPointAtLength(c.getTotalLength() / 2), m = c.getScreenCTM();"
        "const b = document.getElementById('diagram').getBoundingClientRect();"
        "return [m.a * p.x + m.e - b.left - b.width / 2, m.d * p.y + m.f - b.top - b.height / 2]"
    )
    x, y = page.execute_script(script)
    place = page.find_element("id", "diagram")
    ActionChains(page).move_to_element_with_offset(place, round(x), round(y)).click().perform()
    _until(page, "return Number(document.documentElement.dataset.cycles) > arguments[0]", before)
    said = _text(page, "#cycle-facts")
    assert "this cycle isstable" in said
    value = float(re.search(r"V = ([\d.]+)", said)[1])
    assert 110 < value < 150
    for place in (
        "#phase path.curve",
        "#wave path.curve",
        "#circle circle.multiplier",
        "#film path.contact",
        "#peaks td",
    ):
        assert page.find_elements("css selector", place), place
    first = page.execute_script("return document.querySelector('#film path.body').getAttribute('d')")
    _until(page, "return document.querySelector('#film path.body').getAttribute('d') !== arguments[0]", first)


def test_a_bad_value_says_so_on_the_page(page):
    shown = _text(page, "#facts")
    _type(page, "K1", "soft")
    assert "not a number" in _text(page, "#parameter-K1 .wrong")
    _type(page, "K1", "-5")
    assert "allowed is a finite number" in _text(page, "#parameter-K1 .wrong")
    assert _text(page, "#facts") == shown  # the last good diagram stays
    _type(page, "K1", "3.3 MN/m")
    assert _text(page, "#parameter-K1 .wrong") == "" and _text(page, "#facts") != shown
    _reset(page)
