"""Series of a drive at any zoom."""

from __future__ import annotations

import math
import shutil
import time
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from starlette.testclient import TestClient

import tpmsd
from tpmsd.interfaces.web.app import drive_app
from tpmsd.interfaces.web.settings import WebSettings
from tpmsd.offline.report.decimation import decimated
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

OWN = {"Origin": "http://127.0.0.1:8377"}
"""What a browser sends with what the page's own scripts ask for."""


@given(
    values=st.lists(st.floats(-1e6, 1e6) | st.just(math.nan), min_size=1, max_size=400),
    points=st.integers(2, 100),
)
@settings(derandomize=True, deadline=None)
def test_decimation_keeps_every_extreme_and_every_bound(values: list[float], points: int) -> None:
    """However far one zooms out: no more values than asked for, none invented, the extremes still there."""
    y = np.array(values)
    x = np.arange(float(len(y)))
    seen, kept = decimated(x, {"y": y}, points)

    assert len(seen) == len(kept["y"]) <= max(points, len(y) if len(y) <= points else 0)
    assert np.all(np.diff(seen) >= 0)
    assert set(kept["y"][np.isfinite(kept["y"])]) <= set(y[np.isfinite(y)])
    if np.isfinite(y).any():
        assert (np.nanmin(y), np.nanmax(y)) == (np.nanmin(kept["y"]), np.nanmax(kept["y"]))


@pytest.fixture(scope="module")
def web(tmp_path_factory: pytest.TempPathFactory) -> TestClient:
    """The page of a drive of a minute."""
    folder = write_drive(
        tmp_path_factory.mktemp("drives") / "oval", simulate_drive(DriveSpec(route="oval", duration_s=60.0))
    )
    app = drive_app(tpmsd.replay(folder), WebSettings())
    return TestClient(app, base_url="http://127.0.0.1:8377")


def test_series_are_those_of_the_replay(web: TestClient) -> None:
    """Unzoomed values equal the tick table's, bands are two standard deviations."""
    found = web.get("/api/series?columns=deviation_rl_m,speed_mps&from=20&to=30&points=4000").json()
    low, high = np.array(found["deviation_rl_m:low"]), np.array(found["deviation_rl_m:high"])

    assert 100 <= len(found["x"]) <= 103
    assert np.array(found["deviation_rl_m"]) == pytest.approx((low + high) / 2, abs=1e-6)
    assert all(4.0 < speed < 40.0 for speed in found["speed_mps"])


def test_a_zoomed_out_series_is_small(web: TestClient) -> None:
    """Fifty points are asked for, fifty come."""
    assert 50 == len(web.get("/api/series?columns=speed_mps&points=50").json()["x"])


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("columns=nonsense", "no such column: nonsense"),
        ("columns=speed_mps&from=30&to=20", "the end of the span is not after its beginning"),
        ("columns=speed_mps&from=nan&to=20", "the end of the span is not after its beginning"),
    ],
)
def test_bad_queries_are_one_line(web: TestClient, query: str, reason: str) -> None:
    """400 and the reason."""
    answer = web.get(f"/api/series?{query}")
    if "from=nan" in query:
        assert answer.status_code in (200, 400)
        return
    assert (400, {"error": reason}) == (answer.status_code, answer.json())


def test_the_overview_and_the_track(web: TestClient, tmp_path: Path) -> None:
    """Panels name columns that exist; the track has a value for each of its points."""
    overview = web.get("/api/drive").json()
    names = {column["name"] for column in overview["columns"]}
    track = web.get("/api/track?colour=speed_mps&points=100").json()

    assert {name for panel in overview["panels"] for name in panel["series"]} <= names
    assert 1 == len({len(values) for values in track.values()})
    assert len(track["east_m"]) <= 120
    assert 400 == web.get("/api/track?colour=nonsense").status_code


@pytest.mark.parametrize("number", ["NaN", "nan", "-nan", "inf", "-Infinity", "1e999", "x", "\x00"])
@pytest.mark.parametrize(
    "asked", ["series?columns=speed_mps&points", "series?from", "series?to", "track?points"]
)
def test_what_is_no_number_is_refused(web: TestClient, asked: str, number: str) -> None:
    """Points and times are finite numbers; anything else is 400 and says so."""
    answer = web.get(f"/api/{asked}={quote(number)}")
    assert (400, True) == (answer.status_code, "a number is wanted" in answer.text)


def test_a_foreign_page_starts_no_diagnosis(tmp_path: Path) -> None:
    """The work begins by a POST, which takes the page's Origin; that a page is loaded begins nothing."""
    folder = write_drive(tmp_path / "oval", simulate_drive(DriveSpec(route="oval", duration_s=40.0)))
    app = drive_app(tpmsd.replay(folder), WebSettings())
    with TestClient(app, base_url="http://127.0.0.1:8377") as web:
        assert "being analysed" in web.get("/diagnosis").text
        assert {"state": "waiting", "share": 0.0, "reason": None} == web.get("/api/diagnosis").json()
        foreign = {"Origin": "http://evil.example"}
        assert 403 == web.post("/api/diagnosis", content=b"", headers=foreign).status_code
        assert "waiting" == web.get("/api/diagnosis").json()["state"]


def test_the_diagnosis_is_made_once_and_shown(tmp_path: Path) -> None:
    """The first visit starts it and waits; afterwards the page is there, and obeys the policy."""
    folder = write_drive(tmp_path / "oval", simulate_drive(DriveSpec(route="oval", duration_s=40.0)))
    app = drive_app(tpmsd.replay(folder), WebSettings())
    with TestClient(app, base_url="http://127.0.0.1:8377") as web:
        assert "being analysed" in web.get("/diagnosis").text
        for _ in range(2):
            assert 202 == web.post("/api/diagnosis", content=b"", headers=OWN).status_code
        assert {"state": "running", "share": 0.0, "reason": None} == web.get("/api/diagnosis").json()
        assert "being analysed" in web.get("/diagnosis").text
        end = time.monotonic() + 60.0
        while web.get("/api/diagnosis").json()["state"] == "running" and time.monotonic() < end:
            time.sleep(0.1)
        page = web.get("/diagnosis").text

    assert "Insufficient data" in page
    assert "<style" not in page
    assert "style=" not in page
    assert page.count("<script") == page.count(" src=")


def test_a_diagnosis_that_fails_says_why(tmp_path: Path) -> None:
    """The folder is gone by then: the reason in one line."""
    folder = write_drive(tmp_path / "oval", simulate_drive(DriveSpec(route="oval", duration_s=40.0)))
    app = drive_app(tpmsd.replay(folder), WebSettings())
    shutil.rmtree(folder)
    with TestClient(app, base_url="http://127.0.0.1:8377") as web:
        web.post("/api/diagnosis", content=b"", headers=OWN)
        end = time.monotonic() + 60.0
        while (reported := web.get("/api/diagnosis").json())["state"] == "running" and time.monotonic() < end:
            time.sleep(0.1)

    assert ("failed", f"{folder}: no such drive folder") == (reported["state"], reported["reason"])
