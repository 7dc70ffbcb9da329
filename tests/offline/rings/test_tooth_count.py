"""Counts per revolution: by the tyre, by usual rings, and by the wheel's own irregularity."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tpmsd.interfaces.cli.discover import summary
from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.result_files import vehicle_text
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.offline.drives.raw_drive import read_drive
from tpmsd.offline.rings.counter import Counter
from tpmsd.offline.rings.tooth_count import tooth_count, tyre_radius_m
from tpmsd.onboard.sources.can.databases import load_database

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
    """Without a counter the posterior is the rings' weight times the density of the rolling radius."""
    found = tooth_count(per_metre(48), 1e-6, TYRE)
    wrong, wide = SETTINGS.wrong_size, SETTINGS.radius_std_m / SETTINGS.radius_m
    broad = RADIUS_M / SETTINGS.radius_m

    def prior(teeth: int) -> float:
        """Two normal densities: of the size that is given, and of any tyre where that size is wrong."""
        right = math.exp(-0.5 * ((teeth / 48 - 1) / SETTINGS.tyre_radius_std) ** 2)
        other = math.exp(-0.5 * ((teeth / 48 * broad - 1) / wide) ** 2) * broad
        return (1 - wrong) * right / SETTINGS.tyre_radius_std + wrong * other / wide

    odds = 1.2 / 6.0 * prior(47) / prior(48)
    alternatives = dict(found.alternatives)

    assert pytest.approx(RADIUS_M) == tyre_radius_m(TYRE)
    assert (48.0, pytest.approx(RADIUS_M)) == (found.value, found.radius_m)
    assert pytest.approx(odds, rel=1e-3) == alternatives[47.0] / found.probability


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


def test_an_encoder_is_identified_by_its_line() -> None:
    """Of 12,345 counts the number is told to some counts, and its std covers the error."""
    found = tooth_count(per_metre(12_345), 1e-6, TYRE, counters(12_345, 5e-4))
    assert abs(found.value - 12_345) < max(3 * found.std, 2.0)
    assert found.std < 5.0
    none = tooth_count(per_metre(12_345), 1e-6, TYRE, counters(12_345, 0.0))
    assert 0.0 == none.probability
    assert pytest.approx(SETTINGS.tyre_radius_std, rel=0.01) == none.std / none.value


WRONG_TYRE = "235/65R16"
"""A rolling radius 11 % beyond that of `TYRE`."""


@pytest.mark.parametrize(("teeth", "ripple_rad"), [(47, 2e-3), (12_345, 5e-4)])
def test_a_plain_ripple_decides_against_a_wrong_size(teeth: int, ripple_rad: float) -> None:
    """A tyre size that the ripple contradicts changes nothing, and its own count is told beside."""
    wheels = counters(teeth, ripple_rad)
    right = tooth_count(per_metre(teeth), 1e-6, TYRE, wheels)
    found = tooth_count(per_metre(teeth), 1e-6, WRONG_TYRE, wheels)
    radius_m = tyre_radius_m(WRONG_TYRE)

    assert radius_m is not None
    assert abs(found.value - teeth) <= max(3 * found.std, 2.0 if teeth > SETTINGS.max_ring_teeth else 0.0)
    assert found.probability >= SETTINGS.decided
    assert right.by_size is None
    assert found.by_size is not None
    assert pytest.approx(teeth * radius_m / RADIUS_M) == found.by_size[0]
    assert pytest.approx(found.by_size[0] * SETTINGS.tyre_radius_std, rel=0.01) == found.by_size[1]


@pytest.mark.parametrize("size", [None, TYRE, "235/65R16", "195/50R13", "335/30R30"])
def test_a_size_finds_no_line_in_perfect_encoders(size: str | None) -> None:
    """Whatever the size, if any, encoders without a ripple show none, and the size is not contradicted."""
    for seed in range(4):
        found = tooth_count(per_metre(12_345), 1e-6, size, counters(12_345, 0.0, seed))
        assert (0.0, None) == (found.probability, found.by_size)


@pytest.mark.parametrize("drive_name", ["van-oval", "van-motorway-a", "van-motorway-b"])
def test_the_real_van_with_a_wrong_size(recordings: Path, drive_name: str) -> None:
    """The van's ripple stands against a wrong size: the right count is written, the contradiction is said."""
    folder = recordings / drive_name
    drive = read_drive([folder], lambda _: None)
    found = discover(drive.log, drive.fixes, load_database(folder / "bus.dbc"), WRONG_TYRE)

    assert found.counts_per_rev is not None
    assert pytest.approx(39_931, rel=2e-4) == found.counts_per_rev.value
    assert found.counts_probability >= SETTINGS.decided
    assert not [one for one in found.undecided if "ripple" in one.why]
    text = vehicle_text(found, "bus.dbc")
    assert pytest.approx(39_931, rel=2e-4) == tomllib.loads(text)["vehicle"]["teeth_per_rev"]
    assert pytest.approx(0.315, rel=0.01) == tomllib.loads(text)["vehicle"]["wheel_radius_m"]
    (said,) = found.contradictions
    pattern = (
        r"tyre size 235/65R16 needs (\d+) \+- \d+ counts per revolution, the ripple of the rings shows (\d+)"
    )
    match = re.search(pattern, said)
    assert match is not None, said
    assert pytest.approx(43_750, rel=0.01) == int(match[1])
    assert pytest.approx(39_931, rel=2e-4) == int(match[2])
    for shown in ("\n".join(summary(found)), text, json.dumps(found.document())):
        assert said in shown


def test_the_real_van(recordings: Path) -> None:
    """The van's encoders show their 39,931 counts within 0.02 % without the tyre's size."""
    folder = recordings / "van-oval"
    drive = read_drive([folder], lambda _: None)
    found = discover(drive.log, drive.fixes, load_database(folder / "bus.dbc"))
    assert found.counts_per_rev is not None
    assert pytest.approx(39_931, rel=2e-4) == found.counts_per_rev.value
    assert found.counts_probability >= SETTINGS.decided
    assert pytest.approx(0.315, rel=0.01) == found.geometry["wheel_radius_m"].value
