"""The page in a real browser, in front of a real daemon. Run by `make test-web`, as it takes Chromium."""

from __future__ import annotations

import queue
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.browser

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")

AXE = Path(__file__).parents[1] / "web" / "vendor" / "axe.min.js"
PATIENCE_S = 90.0
SPEED_UP = 5.0
STATES = "return ['fl','fr','rl','rr'].map(id => document.getElementById(id).className).join('|')"


@contextmanager
def process(*arguments: str | Path) -> Iterator[tuple[subprocess.Popen[str], queue.Queue[str]]]:
    """A program of this repository with its lines (both streams) in a queue; ended by all means."""
    running = subprocess.Popen(
        [sys.executable, "-m", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    lines: queue.Queue[str] = queue.Queue()
    assert running.stdout is not None
    stream = running.stdout
    threading.Thread(target=lambda: [lines.put(line) for line in stream], daemon=True).start()
    try:
        yield running, lines
    finally:
        running.kill()
        running.wait()


def line_with(lines: queue.Queue[str], word: str) -> str:
    """The next line that holds a word."""
    end = time.monotonic() + PATIENCE_S
    while (left := end - time.monotonic()) > 0:
        try:
            line = lines.get(timeout=left)
        except queue.Empty:
            break
        if word in line:
            return line
    raise AssertionError(f"no line with {word!r} within {PATIENCE_S:g} s")


@contextmanager
def browser(width: int = 1200, height: int = 900) -> Iterator[Any]:
    """Headless Chromium of Debian's package."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("Chromium and its driver are not installed: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "no-first-run"):
        options.add_argument(f"--{argument}")
    for argument in ("background-networking", "component-update", "sync", "quic"):
        options.add_argument(f"--disable-{argument}")
    options.add_argument(f"--window-size={width},{height}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    one = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        yield one
    finally:
        one.quit()


def wait_until(what: str, true: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
    """Ask again until it is so."""
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        if true():
            return
        time.sleep(0.05)
    raise AssertionError(f"not so within {patience_s:g} s: {what}")


def violations(page: Any) -> list[str]:
    """What axe-core finds against WCAG 2.2 AA."""
    page.execute_script(AXE.read_text(encoding="utf-8"))
    found = page.execute_async_script(
        "const done = arguments[0];"
        "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa', 'wcag22aa']}).then(r => done(r.violations))"
    )
    return [f"{one['id']}: {one['nodes'][0]['html'][:120]}" for one in found]


def complaints(page: Any) -> list[str]:
    """What the browser's console says: errors of scripts, and what the policy has blocked."""
    return [entry["message"] for entry in page.get_log("browser") if entry["level"] == "SEVERE"]


def test_a_puncture_turns_the_right_tyre_red_and_a_restart_is_survived(tmp_path: Path) -> None:
    """Red within 2 s of the alarm's frame, no other tyre; without the daemon it says so, then goes on."""
    car = ("tests.browser.car", tmp_path, "150", str(SPEED_UP))
    web = ("tpmsd", "web", "--config", tmp_path / "vehicle.toml", "--port", "0")
    with process(*car) as (first, alarms):
        wait_until("a daemon", lambda: (tmp_path / "status.sock").exists())
        with process(*web) as (_, said), browser() as page:
            url = line_with(said, "http://").split()[0]
            page.get(url)
            wait_until("four tyres", lambda: page.execute_script(STATES).count("tyre") == 4)
            assert "soft" not in page.execute_script(STATES)
            raised = float(line_with(alarms, "RAISED deflation rl").split()[-1])
            wait_until("red", lambda: "soft" in page.execute_script(STATES), 10.0)
            late = time.monotonic() - raised
            states = page.execute_script(STATES).split("|")
            assert [False, False, True, False] == ["soft" in state for state in states]
            assert late < 2.0
            assert [] == violations(page)
            first.kill()
            first.wait()
            wait_until("lost", lambda: "No data" in page.find_element("id", "connection").text)
            with process("tests.browser.car", tmp_path, "3000", str(SPEED_UP)):
                wait_until("back", lambda: page.find_element("id", "connection").text.startswith("Live"))
            assert [] == complaints(page)


@pytest.mark.parametrize(("width", "height"), [(400, 800), (1600, 900)])
def test_a_drive_is_shown_without_faults(tmp_path: Path, width: int, height: int) -> None:
    """Map and plots appear, nothing is wider than the screen, and no rule of WCAG 2.2 AA is broken."""
    from tpmsd.simulator.drive import DriveSpec, simulate_drive
    from tpmsd.simulator.drive_writer import write_drive

    write_drive(tmp_path / "d", simulate_drive(DriveSpec(route="oval", duration_s=90.0)))
    with process("tpmsd", "web", tmp_path / "d", "--port", "0") as (_, said), browser(width, height) as page:
        page.get(line_with(said, "http://").split()[0])
        wait_until("plots", lambda: page.execute_script("return document.body.dataset.ready === '1'"))
        assert page.execute_script("return document.querySelectorAll('.uplot').length") >= 5
        wide = page.execute_script("return document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0
        assert [] == violations(page)
        assert [] == complaints(page)
