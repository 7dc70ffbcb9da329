"""Pictures of the pages: `python -m tests.browser.screenshots FOLDER [--all]`.

In: a simulated car with a puncture, a recorded drive, the reports of the tests. Out: the pictures of the
docs (`DOCS`), or with `--all` every page at 400 and 1600 pixels in each theme, `PAGE-WIDTH-THEME.png`, to be
looked at.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.browser.chromium import THEMES, MissingBrowserError, emulate, opened, wait_until
from tests.browser.load import line_with, process
from tests.browser.reports import write_reports
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault

WIDTHS = {400: 800, 1600: 1000}
"""Heights of the screens by their widths, CSS pixels."""
READY = "return document.body.dataset.ready === '1'"
Shot = tuple[str, int, str]
"""Name, width and theme of a picture."""
DOCS: dict[str, tuple[Shot, ...]] = {
    "live": (
        ("web-live", 1200, "light"),
        ("web-live-phone", 400, "light"),
        ("web-live-dark", 1200, "dark"),
    ),
    "drive": (("web-drive", 1200, "light"),),
}
"""Of each page."""


def every(page: str) -> Iterator[Shot]:
    """All sizes and themes."""
    for width in WIDTHS:
        for theme in THEMES:
            yield f"{page}-{width}-{theme}", width, theme


def take(page: Any, shots: Iterable[Shot], folder: Path) -> None:
    """The whole page, from its top to its end."""
    for name, width, theme in shots:
        emulate(page, width, theme, WIDTHS.get(width, 900))
        time.sleep(1.0)  # plots have taken the new size
        taken = page.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True})
        (folder / f"{name}.png").write_bytes(base64.b64decode(taken["data"]))
        print(folder / f"{name}.png")


@contextmanager
def live_page(folder: Path, page: Any) -> Iterator[None]:
    """The live page with a soft rear left tyre, some minutes after the alarm."""
    car = ("tests.browser.car", folder, "240", "8")
    with process(*car) as (_, alarms):
        wait_until("a daemon", (folder / "status.sock").exists)
        web = ("tpmsd", "web", "--config", folder / "vehicle.toml", "--port", "0")
        with process(*web) as (_, said):
            page.get(line_with(said, "http://").split()[0])
            line_with(alarms, "RAISED deflation rl")
            time.sleep(20.0)
            yield


@contextmanager
def drive_page(folder: Path, page: Any) -> Iterator[None]:
    """A recorded drive with a slow leak."""
    leak = Fault("leak", size=0.7, size_unit="percent", wheel="rl", onset_s=180.0, duration_s=60.0)
    write_drive(folder, simulate_drive(DriveSpec(route="mixed", duration_s=360.0, seed=1, faults=(leak,))))
    with process("tpmsd", "web", folder, "--port", "0") as (_, said):
        page.get(line_with(said, "http://").split()[0])
        wait_until("plots", lambda: page.execute_script(READY))
        yield


def main() -> int:
    """Take them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--all", action="store_true", help="every page, size and theme instead of the docs'")
    parser.add_argument("--only", metavar="PAGE", help="live, drive, replay, diagnosis or fleet")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    try:
        chromium = opened()
    except MissingBrowserError as error:
        print(error, file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as scratch, chromium as page:
        page.execute_cdp_cmd("Emulation.setScrollbarsHidden", {"hidden": True})
        for name, served in (("live", live_page), ("drive", drive_page)):
            if args.only in (None, name):
                with served(Path(scratch) / name, page):
                    take(page, every(name) if args.all else DOCS[name], args.folder)
        for name, path in write_reports(Path(scratch)).items() if args.all else ():
            if args.only in (None, name):
                page.get(path.as_uri())
                wait_until("ready", lambda: page.execute_script(READY))
                take(page, every(name), args.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
