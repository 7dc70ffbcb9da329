"""Counts per revolution: by the tyre, by usual rings, and by the wheel's own irregularity."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.series import Counter
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.offline.discovery.tooth_count import tooth_count, tyre_radius_m
from tpmsd.offline.drives.raw_drive import read_drive
from tpmsd.onboard.sources.databases import load_database

TYRE = "205/55R16"
RADIUS_M = 0.969 * (0.5 * 16 * 0.0254 + 0.205 * 0.55)


def counters(teeth: float, ripple_rad: float, seed: int = 1) -> list[tuple[Counter, float]]:
    """Four wheels over ten minutes at 50 Hz, speeds of 9 to 25 m/s, whole counts."""
    rng = np.random.default_rng(seed)
    time_s = 0.02 * np.arange(30_000)
    speed = 17.0 + 6.0 * np.sin(2 * np.pi * time_s / 97.0) + 2.0 * np.sin(2 * np.pi * time_s / 13.0)
    wheels = []
    for _ in range(4):
        angle = np.cumsum(speed) * 0.02 / RADIUS_M + rng.uniform(0, 6)
        shown = angle + ripple_rad * np.sin(angle + rng.uniform(0, 6))
        wheels.append((Counter(time_s, np.floor(shown * teeth / (2 * np.pi)), 1 << 16, True), 1.0))
    return wheels


def per_metre(teeth: float) -> float:
    return teeth / (2 * math.pi * RADIUS_M)


def test_tyre_and_usual_rings() -> None:
    """Without a counter the posterior is the rings' weight times the tyre's normal density."""
    found = tooth_count(per_metre(48), 1e-6, TYRE)
    odds = 1.2 / 6.0 * math.exp(-0.5 * (1 / 48 / SETTINGS.tyre_radius_std) ** 2)
    rivals = dict(found.rivals)

    assert pytest.approx(RADIUS_M) == tyre_radius_m(TYRE)
    assert (48.0, pytest.approx(RADIUS_M)) == (found.value, found.radius_m)
    assert pytest.approx(odds, rel=1e-3) == rivals[47.0] / found.probability


@pytest.mark.parametrize(("teeth", "tyre"), [(47, TYRE), (53, None), (100, None)])
def test_the_ripple_tells_the_count(teeth: int, tyre: str | None) -> None:
    """A ring 0.1 mm off its centre tells its teeth, usual or not, with and without the tyre's size."""
    found = tooth_count(per_metre(teeth), 1e-6, tyre, counters(teeth, 2e-3))
    assert (float(teeth), SETTINGS.max_probability) == (found.value, found.probability)


def test_perfect_rings_tell_nothing() -> None:
    """Perfect rings and no tyre size leave the number undecided, in each of eight draws."""
    for seed in range(8):
        found = tooth_count(per_metre(47), 1e-6, None, counters(47, 0.0, seed))
        assert SETTINGS.decided > found.probability


def test_constant_speeds_tell_nothing() -> None:
    """At constant speeds the rounding of counts beats against the frames; no ring is read from that."""
    time_s = 0.02 * np.arange(30_000)
    for seed in range(8):
        rng = np.random.default_rng([seed, 5])
        speed = rng.uniform(9.0, 25.0, 12)[(time_s / 50.0).astype(np.int64)]
        wheels = []
        for _ in range(4):
            angle = np.cumsum(speed) * 0.02 / (RADIUS_M * (1.0 + 6e-4 * rng.normal())) + rng.uniform(0, 6)
            wheels.append((Counter(time_s, np.floor(angle * 47 / (2 * np.pi)), 1 << 16, True), 1.0))
        found = tooth_count(per_metre(47), 1e-6, None, wheels)
        assert SETTINGS.decided > found.probability


def test_an_encoder_is_told_by_its_line() -> None:
    """Of 12,345 counts the number is told to some counts, and its std covers the error."""
    found = tooth_count(per_metre(12_345), 1e-6, TYRE, counters(12_345, 5e-4))
    assert abs(found.value - 12_345) < max(3 * found.std, 2.0)
    assert found.std < 5.0
    none = tooth_count(per_metre(12_345), 1e-6, TYRE, counters(12_345, 0.0))
    assert 0.0 == none.probability
    assert pytest.approx(SETTINGS.tyre_radius_std, rel=0.01) == none.std / none.value


def test_the_real_van(recordings: Path) -> None:
    """The van's encoders show their 39,931 counts within 0.02 % without the tyre's size."""
    folder = recordings / "van-oval"
    drive = read_drive([folder], lambda _: None)
    found = discover(drive.log, drive.fixes, load_database(folder / "bus.dbc"))
    assert found.counts_per_rev is not None
    assert pytest.approx(39_931, rel=2e-4) == found.counts_per_rev.value
    assert found.counts_probability >= SETTINGS.decided
    assert pytest.approx(0.315, rel=0.01) == found.geometry["wheel_radius_m"].value
