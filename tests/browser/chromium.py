"""Headless Chromium of Debian's package, driven by Selenium.

In: a size and a theme. Out: a page to drive and to look at.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from tests.browser.load import PATIENCE_S

THEMES: dict[str, dict[str, str]] = {
    "light": {"prefers-color-scheme": "light", "forced-colors": "none"},
    "dark": {"prefers-color-scheme": "dark", "forced-colors": "none"},
    "forced": {"prefers-color-scheme": "dark", "forced-colors": "active"},
}
"""Media features of each theme; `forced` is the high contrast of an operating system."""


class MissingBrowserError(Exception):
    """Chromium or its driver is not installed."""


def opened(width: int = 1200, height: int = 900) -> AbstractContextManager[Any]:
    """A browser, closed at the end; MissingBrowserError where there is none."""
    from selenium import webdriver

    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        raise MissingBrowserError(
            "Chromium and its driver are not installed: apt-get install chromium chromium-driver"
        )
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "no-first-run"):
        options.add_argument(f"--{argument}")
    for argument in ("background-networking", "component-update", "sync", "quic"):
        options.add_argument(f"--disable-{argument}")
    options.add_argument(f"--window-size={width},{height}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))


def emulate(page: Any, width: int, theme: str, height: int = 900) -> None:
    """A screen of that size in CSS pixels, in a theme of `THEMES`."""
    features = [{"name": name, "value": value} for name, value in THEMES[theme].items()]
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "screen", "features": features})
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def wait_until(what: str, true: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
    """Ask again until it is so."""
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        if true():
            return
        time.sleep(0.05)
    raise AssertionError(f"not so within {patience_s:g} s: {what}")
