"""The receiver's statistics against its specification, its timing, and its sentences read by pynmea2."""

from __future__ import annotations

import math
import re

import numpy as np
import pynmea2
import pytest

from tests.offline.simulator.drives import straight, world_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.nmea import Epoch, sentence, with_checksum
from tpmsd.offline.simulator.receiver import Epochs, NmeaLine, ReceiverSpec, measure_epochs, nmea_lines
from tpmsd.offline.simulator.world import World

CLOCKS = Clocks()


def epochs_of(world: World, spec: ReceiverSpec, seed: int = 1) -> Epochs:
    """What this receiver measures."""
    return measure_epochs(world, spec, CLOCKS, np.random.default_rng(seed))


def lines_of(world: World, spec: ReceiverSpec, clocks: Clocks = CLOCKS, seed: int = 1) -> list[NmeaLine]:
    """What it says."""
    rng = np.random.default_rng(seed)
    return nmea_lines(world, measure_epochs(world, spec, clocks, rng), spec, clocks, rng)


def autocorrelation(values: np.ndarray, lag: int) -> float:
    """Of a sequence with mean zero."""
    return float(np.mean(values[:-lag] * values[lag:]) / np.mean(values**2))


@pytest.fixture(scope="module")
def hours() -> Epochs:
    """Four hours of a 1 Hz receiver on a straight."""
    return epochs_of(world_of(straight(20.0, 14_400.0)), ReceiverSpec(rate_hz=1.0))


def test_position_error_is_as_large_and_as_slow_as_specified(hours: Epochs) -> None:
    """1.2 m of slow error and 0.15 m of white error per axis; a correlation of 1/e after 30 s."""
    error = np.concatenate([hours.east_error_m, hours.north_error_m])
    expected = math.exp(-1) * 1.44 / (1.44 + 0.0225)

    assert pytest.approx(math.hypot(1.2, 0.15), rel=0.06) == error.std()
    assert pytest.approx(expected, abs=0.08) == autocorrelation(hours.east_error_m, 30)


def test_white_part_shows_from_epoch_to_epoch(hours: Epochs) -> None:
    """Differences of neighbours have the variance 2 * 0.15^2 + 2 * 1.2^2 * (1 - exp(-1/30))."""
    steps = np.diff(hours.north_error_m)
    expected = math.sqrt(2 * 0.0225 + 2 * 1.44 * (1 - math.exp(-1 / 30)))

    assert pytest.approx(expected, rel=0.03) == steps.std()


def test_doppler_velocity_is_far_better_than_position_differences(hours: Epochs) -> None:
    """0.05 m/s per axis with a memory of a second, and no bias."""
    error = hours.east_mps - hours.track.east_mps

    assert pytest.approx(0.05, rel=0.03) == error.std()
    assert pytest.approx(math.exp(-1), abs=0.03) == autocorrelation(error, 1)
    assert abs(error.mean()) < 0.003


def test_course_noise_is_velocity_noise_over_speed(hours: Epochs) -> None:
    """At 20 m/s the course scatters by 0.05 / 20 rad."""
    course = np.arctan2(hours.north_mps, hours.east_mps) - np.arctan2(
        hours.track.north_mps, hours.track.east_mps
    )

    assert pytest.approx(0.0025, rel=0.03) == course.std()


@pytest.mark.parametrize("rate", [1.0, 4.0, 10.0])
def test_epochs_fall_on_multiples_of_the_period_in_utc(rate: float) -> None:
    """Whatever the start's fraction of a second is, UTC times rate is whole."""
    clocks = Clocks(start_utc_s=1_719_820_800.33)
    world = world_of(straight(20.0, 20.0))
    found = measure_epochs(world, ReceiverSpec(rate_hz=rate), clocks, np.random.default_rng(1))
    ticks = clocks.utc_s(found.time_s) * rate

    assert pytest.approx(np.rint(ticks), abs=1e-5) == ticks
    assert abs(len(ticks) - 20 * rate) <= 1


def test_sentences_say_where_when_and_how_fast() -> None:
    """RMC and GGA, read by pynmea2, give back the truth of a perfect receiver."""
    perfect = ReceiverSpec(position_std_m=0.0, white_std_m=0.0, velocity_std_mps=0.0, rate_hz=1.0)
    world = world_of(straight(20.0, 30.0, heading_rad=math.pi / 2))
    lines = lines_of(world, perfect)
    rmc, gga = pynmea2.parse(lines[20].text, check=True), pynmea2.parse(lines[21].text, check=True)

    assert ("2024-07-01 08:00:10+00:00", "A") == (str(rmc.datetime), rmc.status)
    assert pytest.approx(50.11 + math.degrees(200.0 / 6_373_200.0), abs=2e-7) == rmc.latitude
    assert pytest.approx((rmc.latitude, 8.68), abs=2e-8) == (gga.latitude, gga.longitude)
    assert pytest.approx((20.0 * 3600 / 1852, 0.0), abs=1e-3) == (rmc.spd_over_grnd, rmc.true_course)
    assert pytest.approx(160.0) == gga.altitude + float(gga.geo_sep)


def test_a_right_turn_raises_the_course() -> None:
    """NMEA's course is clockwise from north: 10 s of 0.1 rad/s to the right make 57.3 degrees."""
    perfect = ReceiverSpec(position_std_m=0.0, white_std_m=0.0, velocity_std_mps=0.0, rate_hz=1.0)
    lines = lines_of(world_of(straight(20.0, 30.0, math.pi / 2, yaw=-0.1)), perfect)

    assert pytest.approx(57.30, abs=0.02) == pynmea2.parse(lines[20].text).true_course


def test_a_standing_receiver_gives_no_course() -> None:
    """Below 1 m/s the course stays empty, in RMC and VTG; the speed is there."""
    spec = ReceiverSpec(sentences=("RMC", "VTG"))
    for line in lines_of(world_of(straight(0.2, 10.0)), spec):
        message = pynmea2.parse(line.text, check=True)
        if message.sentence_type == "RMC":
            assert (None, True) == (message.true_course, message.spd_over_grnd is not None)
        else:
            assert (None, True) == (message.true_track, message.spd_over_grnd_kmph is not None)


def test_in_an_outage_the_fields_are_empty_and_the_clock_goes_on() -> None:
    """Status V, quality 0, no position, for just the listed time."""
    lines = lines_of(world_of(straight(20.0, 30.0)), ReceiverSpec(rate_hz=1.0, outages=((10.0, 15.0),)))
    messages = [pynmea2.parse(line.text, check=True) for line in lines]
    void = [m for m in messages if m.sentence_type == "RMC" and m.status == "V"]
    blind = [m for m in messages if m.sentence_type == "GGA" and m.gps_qual == 0]

    assert [10, 11, 12, 13, 14] == [m.timestamp.second for m in void]
    assert [("", "")] * 5 == [(m.lat, m.lon) for m in blind]


def test_random_outages_and_jumps_come_as_often_as_asked() -> None:
    """At 60 an hour of 10 s each about a sixth of the time is blind; jumps widen the error's tails."""
    world = world_of(straight(20.0, 7200.0))
    blind = epochs_of(world, ReceiverSpec(rate_hz=1.0, outages_per_hour=60.0, outage_s=10.0))
    jumpy = epochs_of(world, ReceiverSpec(rate_hz=1.0, jumps_per_hour=60.0, jump_m=10.0))
    calm = epochs_of(world, ReceiverSpec(rate_hz=1.0))

    assert pytest.approx(1 - math.exp(-1 / 6), abs=0.05) == 1.0 - blind.valid.mean()
    assert np.abs(calm.east_error_m).max() < 6.0
    assert 8.0 < np.abs(jumpy.east_error_m).max() < 25.0


def test_sentences_arrive_late_and_never_early() -> None:
    """Arrival minus validity is the latency, the latency effect and a one-sided jitter."""
    effect = make_effect("gnss_latency", latency_s=0.085)
    world = world_of(straight(20.0, 600.0), ExtendedModel((effect,)))
    spec = ReceiverSpec(rate_hz=5.0, latency_s=0.06, jitter_s=0.004)
    lines = lines_of(world, spec)[::2]
    lag = np.array([line.time_s for line in lines]) - (CLOCKS.start_utc_s + 0.2 * np.arange(len(lines)))

    assert lag.min() >= 0.145 - 1e-6
    assert pytest.approx(0.149, abs=5e-4) == lag.mean()


def test_the_second_sentence_waits_for_the_line() -> None:
    """At 9600 baud n characters take 10 * (n + 2) / 9600 s; epochs never overtake each other."""
    lines = lines_of(world_of(straight(20.0, 20.0)), ReceiverSpec(rate_hz=10.0, baud=9600))
    gaps = np.diff([line.time_s for line in lines])

    assert pytest.approx(10 * (len(lines[0].text) + 2) / 9600, abs=1e-6) == gaps[0]
    assert gaps.min() > 0.0


def test_the_host_clock_is_off_and_drifts() -> None:
    """Arrivals are on the host's clock: off by 2.5 s at the start, and 50 ppm of a 100 s drive later."""
    clocks = Clocks(host_offset_s=2.5, host_drift_ppm=50.0)
    spec = ReceiverSpec(rate_hz=1.0, latency_s=0.0, jitter_s=0.0)
    lines = lines_of(world_of(straight(20.0, 100.0)), spec, clocks)

    assert pytest.approx(2.5, abs=1e-6) == lines[0].time_s - clocks.start_utc_s
    assert pytest.approx(2.505, abs=1e-6) == lines[200].time_s - clocks.start_utc_s - 100.0


def test_every_sentence_is_read_by_an_independent_parser() -> None:
    """RMC, GGA, VTG, GST and ZDA of another talker pass pynmea2's checksum and hold their numbers."""
    spec = ReceiverSpec(rate_hz=1.0, talker="GP", sentences=("RMC", "GGA", "VTG", "GST", "ZDA"))
    lines = lines_of(world_of(straight(20.0, 10.0)), spec)
    kinds = {m.sentence_type: m for m in (pynmea2.parse(line.text, check=True) for line in lines[:5])}

    assert {"RMC", "GGA", "VTG", "GST", "ZDA"} == set(kinds)
    assert "GP" == kinds["RMC"].talker
    assert pytest.approx(72.0, abs=0.5) == float(kinds["VTG"].spd_over_grnd_kmph)
    assert 0.5 < float(kinds["GST"].std_dev_latitude) < 3.0
    assert (1, 7, 2024) == (kinds["ZDA"].day, kinds["ZDA"].month, kinds["ZDA"].year)


def test_angles_round_without_sixty_minutes() -> None:
    """A hair below 51 degrees south prints as 5100.000000, never as 5060.000000; 359.999 degrees as 0."""
    epoch = Epoch(0.9999, True, -50.99999999999, -0.5, 0.0, 5.0, 359.999, 1.0, 9, 1.0)
    text = sentence("RMC", epoch)

    assert "$GNRMC,000001.000,A,5100.000000,S,00030.000000,W,9.719,0.00,010170,,,A" == text[:-3]


def test_checksum_of_a_published_sentence() -> None:
    """The classic example of the GGA sentence has the checksum 47."""
    body = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"

    assert f"${body}*47" == with_checksum(body)


def test_all_lines_have_the_form_of_nmea() -> None:
    """Dollar, printable ASCII, star, two hexadecimal digits; below the 82 characters of the standard."""
    for line in lines_of(world_of(straight(20.0, 10.0)), ReceiverSpec()):
        assert re.fullmatch(r"\$[A-Z]{5},[ -)+-~]*\*[0-9A-F]{2}", line.text)
        assert len(line.text) <= 80


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate_hz": 0.0}, "receiver rate 0 Hz is outside 0.1 to 50 Hz"),
        ({"sentences": ("RMC", "GSV")}, r"unknown sentence 'GSV' \(sentences: RMC GGA VTG GST ZDA\)"),
    ],
)
def test_receivers_that_cannot_be(options: dict[str, object], message: str) -> None:
    """One line says what is wrong."""
    with pytest.raises(ConfigError, match=f"^{message}$"):
        ReceiverSpec(**options)
