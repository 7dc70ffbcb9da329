"""The origins of drives: traffic, recorded and published errors, awkward conditions, pieces of recordings."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.diagnosis.draw import draw_case
from bench.campaigns.offline.diagnosis.make import make as made_of
from bench.campaigns.offline.diagnosis.truth import truth_of
from bench.campaigns.offline.origins import Job, make, plan
from bench.worlds import awkward, polled, real_drives, receiver_residuals, traffic
from bench.worlds.course import Array, Course, wheel_rates
from bench.worlds.folder import Message, wheel_messages
from bench.worlds.instruments import Drive, Errors, observe
from bench.worlds.kinematic import course
from bench.worlds.mems_gyro import AllanNoise, allan_deviation
from bench.worlds.origins import ORIGINS, Places
from bench.worlds.recordings import Recorded
from bench.worlds.spec import Spec

SAMPLE = Path(__file__).parent / "data" / "traffic-sample.npz"
NOWHERE = Places(Path("nowhere"), Path("nowhere"))


@pytest.fixture(scope="module")
def town() -> tuple[traffic.Trace, Course]:
    """Five minutes of a simulated town, and the car's motion."""
    trace = traffic.load(SAMPLE)
    return trace, traffic.course_of(trace, np.random.default_rng(1))


def test_a_car_follows_the_traffic_simulators_path(town: tuple[traffic.Trace, Course]) -> None:
    """Way and direction are the trace's; curvature and lateral acceleration are a car's."""
    trace, road = town
    steps = np.diff(np.stack([trace.x_m, trace.y_m]), axis=1)
    distance = float(np.hypot(*steps).sum())
    moved = np.hypot(*steps) > 0.3
    turned = np.unwrap(np.arctan2(steps[1], steps[0])[moved])

    assert float(np.sum(road.speed) * 0.02) == pytest.approx(distance, rel=0.01)
    apart = road.heading[-1] - road.heading[0] - (turned[-1] - turned[0])
    assert math.remainder(apart, 2 * math.pi) == pytest.approx(0.0, abs=0.1)
    assert np.abs(road.bend).max() <= traffic.TIGHTEST_PER_M
    assert np.abs(road.a_lat).max() < 1.1 * traffic.MAX_LATERAL_MPS2
    assert np.abs(road.accel).max() < 5.0


def test_the_smoothed_path_stays_on_the_road(town: tuple[traffic.Trace, Course]) -> None:
    """The heading is that of the trace to within some degrees wherever the car drives straight on."""
    trace, road = town
    frames = np.arange(len(trace.x_m)) * traffic.FRAME_S
    steps = np.gradient(np.stack([trace.x_m, trace.y_m]), axis=1)
    heading = np.unwrap(np.arctan2(steps[1], steps[0]))
    ours = np.interp(frames, road.time_s, road.heading)
    moving = (trace.speed_mps > 5.0) & (np.abs(np.gradient(heading)) < 0.002)
    apart = (ours - heading - np.median((ours - heading)[moving]))[moving]

    assert moving.sum() > 500
    assert float(np.percentile(np.abs(apart), 90)) < math.radians(6.0)


@pytest.mark.parametrize(
    "noise",
    [AllanNoise(1e-4, 0.0), AllanNoise(0.0, 0.0, 1e-5), AllanNoise(0.0, 0.0, 0.0, 1e-4)],
    ids=["angle random walk", "rate random walk", "quantization"],
)
def test_a_gyros_noise_has_the_allan_deviation_of_its_coefficients(noise: AllanNoise) -> None:
    """Averaging times from 0.2 to 10 s against the closed form of IEEE Std 952."""
    taus = np.array([0.2, 1.0, 3.0, 10.0])
    found = np.mean(
        [
            allan_deviation(noise.drawn(30_000, 0.02, np.random.default_rng(k)), 0.02, taus) ** 2
            for k in range(4)
        ],
        axis=0,
    )

    assert np.sqrt(found) == pytest.approx(noise.deviation(taus), rel=0.1)


def test_bias_instability_is_a_plateau() -> None:
    """From one second to a minute the Allan deviation stays within a fifth of 0.664 B."""
    noise, taus = AllanNoise(0.0, 1e-4), np.array([1.0, 5.0, 20.0, 60.0])
    found = np.mean(
        [
            allan_deviation(noise.drawn(60_000, 0.02, np.random.default_rng(k)), 0.02, taus) ** 2
            for k in range(6)
        ],
        axis=0,
    )

    assert np.sqrt(found) == pytest.approx(np.full(4, 0.664e-4), rel=0.2)


def _recorded(rng: np.random.Generator, place_m: float, doppler_mps: float) -> Recorded:
    """Four minutes at 20 m/s in a wide bend, fixes at 10 Hz."""
    time_s = np.arange(0.0, 240.0, 0.01)
    fixes = np.arange(1.0, 239.0, 0.1)
    angle = 20.0 * fixes / 800.0
    where = 800.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
    return Recorded(
        name="made",
        time_s=time_s,
        distance_m=np.repeat(20.0 * time_s[:, None], 2, axis=1),
        fix_utc_s=fixes,
        fix_m=where + rng.normal(0.0, place_m, where.shape),
        fix_speed_mps=20.0 + rng.normal(0.0, doppler_mps, len(fixes)),
        fix_course_rad=np.full(len(fixes), np.nan),
        track_m=1.6,
        antenna_left_m=0.0,
    )


def test_residuals_of_a_recording_are_the_receivers_errors() -> None:
    """White errors of a known size come back, along and across the way and in speed."""
    blocks = receiver_residuals.residuals(_recorded(np.random.default_rng(3), 0.2, 0.06))
    place = np.concatenate([block.place_m for block in blocks])
    speed = np.concatenate([block.velocity_mps[:, 0] for block in blocks])

    assert place.std(axis=0) == pytest.approx([0.2, 0.2], rel=0.12)
    assert speed.std() == pytest.approx(0.06, rel=0.1)


def test_blocks_are_drawn_where_the_real_car_drove_as_fast() -> None:
    """A receiver that errs at speed alone errs in a simulated drive at speed alone."""
    rng = np.random.default_rng(4)
    n = round(receiver_residuals.BLOCK_S * receiver_residuals.RATE_HZ)
    blocks = tuple(
        receiver_residuals.Block(speed, np.full((n, 2), 0.0), rng.normal(0.0, std, (n, 2)))
        for speed, std in [(5.0, 0.0)] * 10 + [(25.0, 0.2)] * 10
    )
    time_s = np.arange(0.0, 400.0, 0.2)
    speed = np.where(time_s < 200.0, 5.0, 25.0)
    _, rate = receiver_residuals.Library(blocks).drawn(time_s, speed, np.zeros(len(time_s)), rng)

    assert 0.0 == float(np.abs(rate[time_s < 180.0]).max())
    assert rate[time_s > 220.0].std(axis=0) == pytest.approx([0.2, 0.2], rel=0.1)


def _steady(spec: Spec, accel: float) -> Drive:
    """A minute on a straight from 10 m/s, faster by `accel` each second, without noise."""
    time_s = np.arange(0.0, 60.0, 0.02)
    speed = 10.0 + accel * time_s
    nothing = np.zeros(len(time_s))
    straight = Course(
        *(time_s, speed, nothing, nothing, nothing, np.full(len(time_s), accel), nothing, nothing, nothing)
    )
    quiet = replace(spec, rough=0.0, frame_jitter_s=0.0, radius_spread_m=0.0, edge_noise_rad=0.0)
    return observe(straight, quiet, np.random.default_rng(1), 1)


@pytest.mark.parametrize(
    ("changed", "late_s"),
    [
        ({}, 0.0),
        ({"speed_window_s": 0.04}, 0.02),
        ({"speed_filter_s": 0.03}, 0.03),
        ({"speed_window_s": 0.02, "speed_filter_s": 0.01}, 0.02),
    ],
)
def test_averaged_and_filtered_wheel_speeds_lag_by_the_closed_form(
    changed: dict[str, float], late_s: float
) -> None:
    """Half the window and the filter's time constant: what a car that speeds up evenly shows."""
    spec = Spec(wheel_signal="speeds", speed_step_kmh=1e-3, radius_off=0.0, **changed)  # type: ignore[arg-type]
    message = wheel_messages(_steady(spec, 0.5))[0]
    shown = message.raw[100:, 0] * 1e-3 / 3.6

    assert float(np.mean(10.0 + 0.5 * message.time_s[100:] - shown)) == pytest.approx(0.5 * late_s, abs=5e-4)


def test_means_of_two_messages_out_of_step_are_equally_old() -> None:
    """Of 18 ms each, the one sent at the samples of the drive, the other between them."""
    spec = Spec(wheel_signal="speeds", speed_step_kmh=1e-3, speed_window_s=0.018, split_wheels=True)
    front, rear = wheel_messages(_steady(spec, 0.5))

    def age_s(message: Message) -> float:
        shown = message.raw[100:, 0] * 1e-3 / 3.6
        return float(np.mean(10.0 + 0.5 * message.time_s[100:] - shown)) / 0.5

    assert pytest.approx((0.009, 0.009), abs=2e-4) == (age_s(front), age_s(rear))


def test_counts_are_lost_below_the_sensors_speed() -> None:
    """A wheel that rolls slower than the limit gives no edge; faster it gives all."""
    blind = _steady(Spec(blind_below_mps=20.0), 0.5)
    before = np.ptp(blind.shown_rad[blind.time_s < 19.9], axis=0)
    after = np.diff(blind.shown_rad[[1500, -1]], axis=0)[0] * 0.31

    assert before == pytest.approx(np.zeros(4))
    assert after == pytest.approx(np.full(4, float(np.trapezoid(10.0 + 0.5 * blind.time_s[1500:], dx=0.02))))


def test_an_axle_on_ice_spins_for_its_span_and_no_longer() -> None:
    """The named wheels turn faster by the slip, the others not at all."""
    spec = awkward.fault("spin_on_ice", Spec(duration_s=300.0), np.random.default_rng(2))
    road = course(spec, np.random.default_rng(3))
    event = spec.physics["wheel_spin"]
    surplus = wheel_rates(road, spec) / wheel_rates(road, replace(spec, physics={})) - 1.0
    middle = np.abs(road.time_s - event["onset_s"] - 0.5 * event["duration_s"]) < 0.4 * event["duration_s"]
    moving = road.speed > 1.0

    assert surplus[middle & moving][:, event["wheels"]].mean() == pytest.approx(event["slip"])
    assert 0.0 == float(
        np.abs(surplus[middle & moving][:, [w for w in range(4) if w not in event["wheels"]]]).sum()
    )
    outside = moving & (
        (road.time_s < event["onset_s"]) | (road.time_s > event["onset_s"] + event["duration_s"])
    )
    assert 0.0 == float(np.abs(surplus[outside]).sum())


def test_awkward_drives_are_tight_slow_or_badly_received() -> None:
    """Every condition turns up in sixty draws; tight corners are tight, and no car leaves the road."""
    specs = [awkward.draw(np.random.default_rng(seed)) for seed in range(60)]
    tags = {tag for spec in specs for tag in spec.tags}
    tight = next(spec for spec in specs if "tight" in spec.tags)
    park = next(spec for spec in specs if "car_park" in spec.tags)

    expected = {
        "tight",
        "car_park",
        "noisy_1hz",
        "tunnels",
        "noisy_gyro",
        "few_teeth",
        "averaged",
        "filtered",
    }
    assert expected == tags
    for spec, slowest, tightest in ((tight, 14.5, 16.0), (park, 4.0, 10.0)):
        road = awkward.course(replace(spec, duration_s=200.0), np.random.default_rng(5))
        assert road.speed.max() < slowest
        assert 1.0 / np.abs(road.bend).max() < tightest
        assert np.abs(road.a_lat).max() < 4.0


def _van(folder: Path) -> None:
    """A minute of the van's encoders at 20 m/s and its sentences, once a second."""
    rate = 20.0 / real_drives.RADIUS_M / (2 * math.pi) * real_drives.COUNTS_PER_REV
    counts = (np.arange(0.0, 60.0, 0.01) * rate).astype("<u4")
    frames = [
        f"({100 + 0.01 * k:.6f}) can0 120#{np.array([c, c], '<u4').tobytes().hex().upper()}"
        for k, c in enumerate(counts)
    ]
    (folder / "can.log").write_text("\n".join(frames) + "\n")
    (folder / "gnss.nmea").write_text("".join(f"({100 + k}.5) $GNGGA,x*00\n" for k in range(60)))


def _turned(folder: Path) -> Array:
    lines = (folder / "can.log").read_text().splitlines()
    return np.array([np.frombuffer(bytes.fromhex(line.split("#")[1]), "<u4") for line in lines]).astype(float)


def test_an_injected_leak_turns_its_wheel_more_after_its_onset(tmp_path: Path) -> None:
    """By what the smaller radius asks for, to within a count; the other wheel is untouched."""
    _van(tmp_path)
    before = _turned(tmp_path)
    leak = real_drives.inject(tmp_path, "radius_change", np.random.default_rng(1))
    after = _turned(tmp_path)
    wheel, onset = ("rl", "rr").index(leak["wheel"]), leak["onset_s"]
    ramp = np.clip((np.arange(6000) * 0.01 - onset) / max(leak["duration_s"], 1e-9), 0.0, 1.0)
    more = real_drives.RADIUS_M / (real_drives.RADIUS_M + leak["deviation_m"] * ramp) - 1.0
    expected = np.cumsum(np.diff(before[:, wheel], prepend=before[0, wheel]) * more)

    assert after[:, 1 - wheel].tolist() == before[:, 1 - wheel].tolist()
    assert after[:, wheel] - before[:, wheel] == pytest.approx(expected, abs=1.0)
    assert expected[-1] > 1000.0


def test_injected_latency_moves_the_sentences_stamps_alone(tmp_path: Path) -> None:
    """All of them by the same time, and no frame."""
    _van(tmp_path)
    frames = (tmp_path / "can.log").read_text()
    late = real_drives.inject(tmp_path, "gnss_latency", np.random.default_rng(1))["latency_s"]
    stamps = [float(line[1:11]) for line in (tmp_path / "gnss.nmea").read_text().splitlines()]

    assert stamps == pytest.approx([100.5 + k + late for k in range(60)], abs=1e-5)
    assert frames == (tmp_path / "can.log").read_text()


def test_a_piece_of_a_recording_is_cut_equally_from_both_logs(tmp_path: Path) -> None:
    """Frames and sentences of the piece's time and no others; the configuration goes along."""
    (tmp_path / "whole").mkdir()
    _van(tmp_path / "whole")
    for name in ("vehicle.toml", "bus.dbc"):
        (tmp_path / "whole" / name).write_text(name)
    begin, end = real_drives.cut(tmp_path / "whole", tmp_path / "piece", np.random.default_rng(1))
    stamps = [float(line[1:11]) for line in (tmp_path / "piece" / "can.log").read_text().splitlines()]

    assert (begin, end) == pytest.approx((100.0, 159.99))  # shorter than the shortest piece: all of it
    assert 5999 == len(stamps)
    assert "bus.dbc" == (tmp_path / "piece" / "bus.dbc").read_text()


def test_a_sentence_gets_the_stamp_of_the_nearest_instant_of_a_loop() -> None:
    """Stamps lie on one grid of a tenth of a second and a little more, at most half of it off, on the average
    not at all."""
    arrival_s = np.arange(0.5, 3000.0, 0.2)
    late = polled.rounded_late(arrival_s, np.random.default_rng(2))
    stamps = arrival_s + late
    every = np.diff(stamps).min()

    assert np.abs(late).max() <= 0.5 * polled.LOOP_S * (1.0 + polled.MAX_MORE)
    assert late.mean() == pytest.approx(0.0, abs=3e-3)
    assert np.abs(np.mod(np.diff(stamps) / every + 0.5, 1.0) - 0.5).max() < 0.01


def test_an_uneven_ring_shows_two_harmonics_of_its_turn() -> None:
    """Of the lines of a turn the first two hold all: sizes from 0.1 to 0.5 mrad."""
    turn = np.arange(256, dtype=np.float64) * 2.0 * math.pi / 256.0
    lines = 2.0 * np.abs(np.fft.rfft(polled.uneven(turn, np.random.default_rng(4)))) / 256.0

    assert np.all((lines[1:3] > polled.MIN_RAD) & (lines[1:3] < polled.MAX_RAD))
    assert np.abs(np.delete(lines, [1, 2])).max() < 1e-12


@pytest.mark.parametrize("name", ["kinematic", "mems", "wheels", "awkward", "polled"])
def test_an_origin_gives_the_same_drive_for_the_same_seed(name: str) -> None:
    """Bit for bit; another seed gives another."""

    def drawn(seed: int) -> Drive:
        rng = np.random.default_rng(seed)
        spec = ORIGINS[name].spec(rng, duration_s=60.0)
        return ORIGINS[name].drive(spec, rng, seed, NOWHERE)[1]

    first, again, other = drawn(1), drawn(1), drawn(2)

    assert first.spec == again.spec
    assert np.array_equal(first.shown_rad, again.shown_rad)
    assert np.array_equal(first.gyro, again.gyro)
    assert not np.array_equal(first.shown_rad[:100], other.shown_rad[:100])


def test_recorded_errors_replace_the_drawn_ones() -> None:
    """A receiver without faster errors leaves the slow ones of the position alone, and true speeds."""
    spec = Spec(duration_s=120.0, position_slow_m=0.0, doppler_mps=0.5, position_white_m=5.0)
    none = Errors(receiver=lambda t, v, h, rng: (np.zeros((len(t), 2)), np.zeros((len(t), 2))))
    rng = np.random.default_rng(1)
    road = course(spec, rng)
    drive = observe(road, spec, rng, 1, none)

    assert drive.fix_speed == pytest.approx(np.interp(drive.fix_true_s, road.time_s, road.speed), abs=1e-6)


def test_an_effect_is_concealed_in_a_drive_of_any_origin() -> None:
    """The kind names the origin; what the drive identifies of the effect is worked out as on any other."""
    case = draw_case("mems/gnss_latency", 1.0, 100_000)
    made = made_of(case, Path("nowhere"))
    truth = truth_of(case, made.windows)

    assert "mems" == case.world
    assert 0.08 == made.drive.fix_age_s
    assert [("gnss_latency", True)] == [(each.effect, each.detectable) for each in truth.effects]
    with pytest.raises(ValueError, match="no such origin: atlantis"):
        draw_case("atlantis/nothing", 0.0, 1)


def test_the_plan_meets_every_origin_before_the_second_seed() -> None:
    """Null drives of all; faults where an origin has them."""
    jobs = plan(["kinematic", "awkward", "real"], ["null", "faults"], 5, 2)
    first = [job for job in jobs if job.seed == 5]

    assert jobs[: len(first)] == first
    assert 3 + len(awkward.FAULTS) + len(real_drives.INJECTED) == len(first)
    assert Job("awkward", "spin_on_ice", 5) in first


def test_a_made_fault_states_its_truth(tmp_path: Path) -> None:
    """The folder is a drive, and the wheels are those of the driven axle."""
    known = make(Job("awkward", "teeth_44_as_48", 16), tmp_path, NOWHERE)

    assert "teeth_per_rev = 48" in (tmp_path / "vehicle.toml").read_text()
    assert 44.0 == known["bus"][2]
    assert (tmp_path / "can.log").stat().st_size > 1_000_000
