"""`tpmsd simulate --onto`: a recording with effects in it, byte for byte what it was elsewhere."""

from __future__ import annotations

import functools
import gzip
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from bench.campaigns.offline.injected import Injected
from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tpmsd.car.config.load import load_config
from tpmsd.car.physics.catalogue import make_effect, parse_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.interfaces.cli.diagnose import read_recording
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.injection import Injection
from tpmsd.offline.simulator.sealed import unseal

NOTHING = (
    "centrifugal_growth:coefficient=0",
    "gnss_latency:latency_s=0",
    "yaw_rate_scale:scale=1",
    "antenna_lever_arm:forward_m=0",
    "radius_change:wheel=rl,deviation_m=0,onset_s=10,duration_s=5",
    "clock_drift:rate=0",
)
FILES = ("vehicle.toml", "bus.dbc", "can.log", "can.log.gz", "gnss.nmea")
SPEC = DriveSpec(duration_s=120.0, seed=3, route="mixed")


def inject(onto: Path, out: Path, *effects: str) -> None:
    """Run the command."""
    words = [word for effect in effects for word in ("--effect", effect)]
    assert 0 == main(["simulate", str(out), "--onto", str(onto), *words])


def same(one: Path, other: Path) -> list[str]:
    """Names of the drive's files that are the same to the last byte."""
    return [
        name
        for name in FILES
        if (one / name).exists() and (one / name).read_bytes() == (other / name).read_bytes()
    ]


def there(folder: Path) -> list[str]:
    """The drive's files."""
    return [name for name in FILES if (folder / name).exists()]


def frames(folder: Path) -> list[tuple[str, str]]:
    """Everything before a frame's data, and the data, of each line of its log."""
    if (folder / "can.log").exists():
        text = (folder / "can.log").read_text("ascii")
    else:
        text = gzip.decompress((folder / "can.log.gz").read_bytes()).decode("ascii")
    return [tuple(line.split("#", 1)) for line in text.splitlines()]  # type: ignore[misc]


@pytest.mark.parametrize("name", ["rav4-suburb-60s", "van-oval", "van-mountain-a"])
def test_effects_of_no_size_leave_a_real_recording_as_it_is(
    recordings: Path, tmp_path: Path, name: str
) -> None:
    """Every file is the same to the last byte: counts, speeds, sentences, stamps, compression."""
    effects = [effect for effect in NOTHING if "radius_change" not in effect or "van" in name]
    inject(recordings / name, tmp_path / "out", *effects)

    assert there(recordings / name) == same(recordings / name, tmp_path / "out")


@pytest.mark.parametrize("kind", ["counts16", "counts8", "split", "speeds"])
def test_effects_of_no_size_leave_a_simulated_drive_as_it_is(tmp_path: Path, kind: str) -> None:
    """On every bus that there is, with lost and repeated frames and a reset of the counters."""
    bus = BusSpec(kind=kind, lost_fraction=0.01, repeated_fraction=0.01, resets_s=(40.0,))
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=60.0, bus=bus)))

    inject(tmp_path / "in", tmp_path / "out", *NOTHING)

    assert there(tmp_path / "in") == same(tmp_path / "in", tmp_path / "out")


@pytest.fixture(scope="module")
def without_effects(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Recording]]:
    """Folder and recording of the drive without effects, on a bus of some kind."""

    @functools.cache
    def made(kind: str) -> tuple[Path, Recording]:
        folder = tmp_path_factory.mktemp("plain")
        write_drive(folder, simulate_drive(replace(SPEC, bus=BusSpec(kind=kind))))
        return folder, read_recording(folder)

    return made


@pytest.mark.parametrize("kind", ["counts16", "counts8", "split", "speeds"])
@pytest.mark.parametrize(
    "effect",
    [
        "centrifugal_growth:coefficient=4e-6",
        "radius_change:wheel=rl,deviation_m=-3e-3,onset_s=50,duration_s=20",
        "track_width_error:rear_m=0.3",
    ],
)
def test_injected_is_what_the_simulator_makes_of_the_effect(
    tmp_path: Path,
    kind: str,
    effect: str,
    without_effects: Callable[[str], tuple[Path, Recording]],
) -> None:
    """The same drive simulated with the effect turns its wheels alike: within a count, or 0.05 % of speed."""
    plain, was = without_effects(kind)
    acting = replace(SPEC, bus=BusSpec(kind=kind), model=model_of(effect))
    write_drive(tmp_path / "acting", simulate_drive(acting))

    inject(plain, tmp_path / "out", effect)

    made, true = (read_recording(tmp_path / name) for name in ("out", "acting"))
    distances = [np.nancumsum(one.rotation_rad, axis=0) for one in (made, true, was)]
    tooth = 2.0 * np.pi / 48.0
    # What the radii made before the drive moved is the simulator's own: both begin at rest.
    assert np.abs(distances[0] - distances[1]).max() < 2.0 * tooth
    assert np.abs(distances[2] - distances[1]).max() > 4.0 * tooth
    if kind != "split":
        stamps = [[before for before, _ in frames(folder)] for folder in (plain, tmp_path / "out")]
        assert stamps[0] == stamps[1]


def model_of(*effects: str) -> ExtendedModel:
    """Of the command line's words."""
    return ExtendedModel(tuple(parse_effect(text) for text in effects))


def test_only_the_signals_of_the_wheels_change(tmp_path: Path) -> None:
    """Growth of the tyres leaves sentences, other messages, and the lengths and stamps of all frames."""
    write_drive(tmp_path / "in", simulate_drive(SPEC))
    before = frames(tmp_path / "in")

    inject(tmp_path / "in", tmp_path / "out", "centrifugal_growth:coefficient=4e-6")

    after = frames(tmp_path / "out")
    assert ["vehicle.toml", "bus.dbc", "gnss.nmea"] == same(tmp_path / "in", tmp_path / "out")
    assert [head for head, _ in before] == [head for head, _ in after]
    assert [len(data) for _, data in before] == [len(data) for _, data in after]
    changed = {head.split()[-1] for (head, old), (_, new) in zip(before, after, strict=True) if old != new}
    assert 1 == len(changed)  # the message of the counters


def test_the_real_van_counts_more_after_a_loss_and_nothing_before(recordings: Path, tmp_path: Path) -> None:
    """On 39,931 counts per revolution a wheel that is 2 mm smaller turns more by 2 / 313, from the onset
    on."""
    onto = recordings / "van-motorway-b"
    loss = "radius_change:wheel=rl,deviation_m=-2e-3,onset_s=200,duration_s=0"
    inject(onto, tmp_path / "out", loss)

    was, made = read_recording(onto), read_recording(tmp_path / "out")
    distances = [np.nansum(one.rotation_rad[2100:, 2:], axis=0) for one in (made, was)]
    # The rolling radius is the calibrated one, within 2 % of the configured 315 mm.
    assert distances[0][0] / distances[1][0] - 1.0 == pytest.approx(2.0 / 315.0, rel=0.02)
    assert distances[0][1] == distances[1][1]
    assert np.array_equal(was.rotation_rad[:1990], made.rotation_rad[:1990], equal_nan=True)
    assert ["vehicle.toml", "bus.dbc", "gnss.nmea"] == same(onto, tmp_path / "out")
    assert [head for head, _ in frames(onto)] == [head for head, _ in frames(tmp_path / "out")]


def test_a_latency_moves_stamps_and_nothing_else(recordings: Path, tmp_path: Path) -> None:
    """Each sentence of the RAV4's receiver comes 0.2 s later; its text stays, and so do all frames."""
    onto = recordings / "rav4-suburb-60s"
    inject(onto, tmp_path / "out", "gnss_latency:latency_s=0.2")

    lines = [(folder / "gnss.nmea").read_text("ascii").splitlines() for folder in (onto, tmp_path / "out")]
    stamps = [[round(1e6 * float(line[1 : line.index(")")])) for line in each] for each in lines]
    assert {200_000} == {b - a for a, b in zip(*stamps, strict=True)}
    assert [line.split(" ", 1)[1] for line in lines[0]] == [line.split(" ", 1)[1] for line in lines[1]]
    assert "can.log.gz" in same(onto, tmp_path / "out")


def test_a_gyro_and_a_speed_of_the_rav4_change_alone(recordings: Path, tmp_path: Path) -> None:
    """4 % more yaw rate, and 1 % more speed of the right rear wheel; the other bytes of their frames stay."""
    onto = recordings / "rav4-suburb-60s"
    loss = "radius_change:wheel=rr,deviation_m=-3.44e-3,onset_s=0,duration_s=0"
    inject(onto, tmp_path / "out", "yaw_rate_scale:scale=1.04", loss)

    was, made = read_recording(onto), read_recording(tmp_path / "out")
    gyros = [one.inertial["yaw_rate_radps"] for one in (was, made)]
    known = np.isfinite(gyros[0]) & (np.abs(gyros[0]) > 0.02)
    assert np.abs(gyros[1][known]).sum() / np.abs(gyros[0][known]).sum() == pytest.approx(1.04, abs=2e-3)
    ratio = np.nansum(made.rotation_rad, axis=0) / np.nansum(was.rotation_rad, axis=0)
    assert ratio[3] - 1.0 == pytest.approx(0.01, rel=0.03)
    assert [1.0, 1.0, 1.0] == ratio[:3].tolist()
    changed = {
        (head.split()[-1], k)
        for (head, old), (_, new) in zip(frames(onto), frames(tmp_path / "out"), strict=True)
        if old != new
        for k in range(len(old))
        if old[k] != new[k]
    }
    assert {identifier for identifier, _ in changed} == {"024", "0AA"}
    assert {k for identifier, k in changed if identifier == "0AA"} <= {8, 9, 10, 11}  # where RR is


@pytest.mark.parametrize(
    ("effect", "parameter", "true"),
    [
        ("centrifugal_growth:coefficient=2.5e-6", "coefficient", 2.5e-6),
        ("gnss_latency:latency_s=0.18", "latency_s", 0.18),
        ("yaw_rate_scale:scale=0.96", "scale", 0.96),
    ],
)
def test_what_was_injected_into_an_independent_world_is_recovered(
    tmp_path: Path, effect: str, parameter: str, true: float
) -> None:
    """The diagnosis names it, and its value is within three standard deviations."""
    spec = Spec(duration_s=420.0, road="rural", doppler_mps=0.03, doppler_tau_s=0.5, position_slow_m=0.6)
    write_folder(drive(spec, 12), tmp_path / "in")

    inject(tmp_path / "in", tmp_path / "out", effect)

    found = {one.effect: one for one in diagnose([read_recording(tmp_path / "out")]).findings}
    name = effect.partition(":")[0]
    assert [name] == list(found)
    quantity = found[name].parameters[parameter]
    assert abs(float(quantity.value) - true) < 3.0 * float(quantity.std or 0.0)


def test_a_clock_that_drifts_moves_all_stamps_by_its_own_law(tmp_path: Path) -> None:
    """Stamps of frames and sentences move alike, by rate times time; data and sentences stay."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=60.0)))
    inject(tmp_path / "in", tmp_path / "out", "clock_drift:rate=1e-3")

    def stamps(name: str, file: str) -> np.ndarray:
        lines = (tmp_path / name / file).read_text("ascii").splitlines()
        return np.array([float(line[1 : line.index(")")]) for line in lines])

    for file in ("can.log", "gnss.nmea"):
        before, after = stamps("in", file), stamps("out", file)
        assert np.polyfit(before - before[0], after - before, 1)[0] == pytest.approx(1e-3, rel=1e-3)
    assert [data for _, data in frames(tmp_path / "in")] == [data for _, data in frames(tmp_path / "out")]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--effect", "road_grade"], "road_grade cannot be injected"),
        ([], "say what to inject"),
        (["--effect", "wear:amount_m=1"], "wear"),
        (["--duration", "60", "--conceal", "1"], "--duration is of a simulated drive"),
        (["--conceal", "0"], "--conceal 0: 1 to 10"),
        (["--conceal", "1", "--effect", "gnss_latency:latency_s=0.1"], "does not go with"),
        (["--effect", "gnss_latency:latency_s=0.1", "--seed", "3"], "--seed goes with --conceal"),
        (["--conceal", "1", "--seed", "-3"], "a seed is 0 or more"),
    ],
)
def test_what_makes_no_sense_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], reason: str
) -> None:
    """And nothing is written."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=20.0)))

    assert 2 == main(["simulate", str(tmp_path / "out"), "--onto", str(tmp_path / "in"), *words])

    assert reason in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_folders_and_logs_that_cannot_be_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording itself, a folder of something else, a log of another format, plain sentences."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=20.0)))
    words = ["--onto", str(tmp_path / "in"), "--effect", "gnss_latency:latency_s=0.1"]
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("mine")

    assert 2 == main(["simulate", str(tmp_path / "in"), *words])
    assert 2 == main(["simulate", str(tmp_path / "other"), *words])
    assert 0 == main(["simulate", str(tmp_path / "out"), *words])
    assert 2 == main(["simulate", str(tmp_path / "out"), *words])
    assert 0 == main(["simulate", str(tmp_path / "out"), *words, "--force"])
    plain = [line.split(" ", 1)[1] for line in (tmp_path / "in" / "gnss.nmea").read_text().splitlines()]
    shutil.copytree(tmp_path / "in", tmp_path / "plain")
    (tmp_path / "plain" / "gnss.nmea").write_text("\n".join(plain) + "\n")
    assert 2 == main(["simulate", str(tmp_path / "no"), "--onto", str(tmp_path / "plain"), *words[2:]])

    said = capsys.readouterr().err.splitlines()
    assert ["thesis.txt"] == [entry.name for entry in (tmp_path / "other").iterdir()]
    for reason in ("the recording itself", "holds files that no", "--force replaces it", "needs the host's"):
        assert 1 == sum(reason in line for line in said)


def test_a_drive_too_short_to_conceal_in_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Unusable input, with the drive and the reason in one line, and nothing written."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=20.0)))

    assert 3 == main(["simulate", str(tmp_path / "out"), "--onto", str(tmp_path / "in"), "--conceal", "1"])

    assert capsys.readouterr().err.splitlines()[-1].endswith("in: the drive is shorter than 90 s")
    assert not (tmp_path / "out").exists()


def test_a_drive_without_its_rear_wheels_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The motion on which effects depend is theirs; the folder is not made."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=20.0, bus=BusSpec(kind="split"))))
    log = tmp_path / "in" / "can.log"
    received = [line for line in log.read_text("ascii").splitlines(keepends=True) if " 1A4#" not in line]
    log.write_text("".join(received), "ascii")
    words = ["--onto", str(tmp_path / "in"), "--effect", "gnss_latency:latency_s=0.1"]

    assert 3 == main(["simulate", str(tmp_path / "out"), *words])
    assert "the rear wheels are not both read" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_truth_of_an_open_injection_is_written(tmp_path: Path) -> None:
    """`truth.json` names recording, effects and values; that of the drive below is not copied."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=20.0)))
    report = tmp_path / "report.json"
    words = ["--onto", str(tmp_path / "in"), "--effect", "gnss_latency:latency_s=0.1", "--json", str(report)]

    assert 0 == main(["simulate", str(tmp_path / "out"), *words])

    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    effects = [{"name": "gnss_latency", "parameters": {"latency_s": 0.1}}]
    assert {"program": "tpmsd simulate", "onto": "in", "effects": effects} == truth
    document = json.loads(report.read_text())
    assert (effects, ["gnss.nmea"], None) == tuple(document[k] for k in ("effects", "changed", "sealed"))


def test_effects_on_fixes_are_those_of_the_time_at_which_they_were_valid(tmp_path: Path) -> None:
    """Fixes that are 0.2 s older than configured change as those of 0.2 s before."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=20.0)))
    config = load_config(tmp_path / "in")
    recording = read_recording(tmp_path / "in")
    smoothed = ExtendedModel((make_effect("gnss_smoothing", time_constant_s=1.0),))
    host_s = recording.start_s + np.arange(5.0, 15.0, 0.5)

    plain, late = (Injection(recording, config, smoothed, age_s) for age_s in (0.0, 0.2))

    then = plain.fix_changes(host_s - 0.2).acting_mps
    assert np.allclose(late.fix_changes(host_s).acting_mps, then, rtol=0.0, atol=1e-4)
    assert not np.allclose(plain.fix_changes(host_s).acting_mps, then, rtol=0.0, atol=0.1)


def test_concealed_effects_are_sealed_and_drawn_by_the_seed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The hash that is printed is the file's; the seed draws the same effects again under another hash."""
    spec = Spec(duration_s=300.0, road="rural", doppler_mps=0.03, position_slow_m=0.6)
    write_folder(drive(spec, 5), tmp_path / "in")
    words = ["--onto", str(tmp_path / "in"), "--conceal", "2", "--seed", "7"]
    for name in ("one", "two"):
        assert 0 == main(["simulate", str(tmp_path / name), *words])
    said = capsys.readouterr().out

    truths = [unseal(tmp_path / name / "truth.sealed") for name in ("one", "two")]
    assert truths[0][0]["effects"] == truths[1][0]["effects"]
    assert truths[0][1] != truths[1][1]
    assert all(sha256 in said for _, sha256 in truths)
    sealed = (tmp_path / "one" / "truth.sealed").read_text("ascii")
    effects = truths[0][0]["effects"]
    assert 2 == len({effect["name"] for effect in effects})
    for effect in effects:
        make_effect(effect["name"], **effect["parameters"])
        assert effect["name"] not in sealed
        assert effect["name"] not in said
    assert there(tmp_path / "one") == same(tmp_path / "one", tmp_path / "two")
    assert not (tmp_path / "one" / "truth.json").exists()


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".trc"])
def test_a_log_of_another_format_becomes_one_of_candump(tmp_path: Path, suffix: str) -> None:
    """The same frames with other counts; without any effect on frames the log itself, to the last byte."""
    write_drive(tmp_path / "in", simulate_drive(replace(SPEC, duration_s=30.0)))
    shutil.copytree(tmp_path / "in", tmp_path / "other")
    (tmp_path / "other" / "can.log").unlink()
    log = tmp_path / "other" / f"can{suffix}"
    with can.Logger(str(log)) as writer:
        for message in can.LogReader(str(tmp_path / "in" / "can.log")):
            message.channel = 0
            writer.on_message_received(message)
    growth = "centrifugal_growth:coefficient=9e-6"

    inject(tmp_path / "other", tmp_path / "none", "gnss_latency:latency_s=0.1")
    assert log.read_bytes() == (tmp_path / "none" / log.name).read_bytes()
    for name in ("in", "other"):
        inject(tmp_path / name, tmp_path / f"out-{name}", growth)
    made = [[data for _, data in frames(tmp_path / f"out-{name}")] for name in ("in", "other")]
    before = [data for _, data in frames(tmp_path / "in")]
    assert len(before) == len(made[1])
    assert before != made[1]
    # Stamps of some formats are rounded: a count may come one frame later.
    assert np.mean([one == other for one, other in zip(*made, strict=True)]) > 0.98
    assert not (tmp_path / "out-other" / log.name).exists()


@pytest.mark.parametrize(
    ("effect", "wheels", "to"),
    [
        (
            "centrifugal_growth:coefficient=1.7e-6",
            lambda one: dict.fromkeys((2, 3), 1.7e-6 * one.speed**2),
            0.03,
        ),
        # There the yaw rate is that of wheels taken as equal, and smoothed three times as wide.
        (
            "load_transfer_lateral:coefficient=4e-4",
            lambda one: {2: 4e-4 * one.across, 3: -4e-4 * one.across},
            0.15,
        ),
    ],
)
def test_effects_are_those_that_other_equations_make(
    recordings: Path,
    tmp_path: Path,
    effect: str,
    wheels: Callable[[Injected], dict[int, np.ndarray]],
    to: float,
) -> None:
    """On a real motorway, against equations and a motion of their own that act on the readings: ways over ten
    seconds are changed alike."""
    onto = recordings / "van-motorway-d"
    inject(onto, tmp_path / "out", effect)
    was, made = read_recording(onto), read_recording(tmp_path / "out")
    other = Injected(was)
    true = other.radii(wheels(other))

    def changes(one: Recording) -> np.ndarray:
        more = np.nan_to_num(one.rotation_rad[:, 2:] - was.rotation_rad[:, 2:])
        return more[: len(more) // 100 * 100].reshape(-1, 100, 2).sum(axis=1).ravel()

    expected, found = changes(true), changes(made)
    slope = float(expected @ found) / float(expected @ expected)
    assert slope == pytest.approx(1.0, abs=to)
    assert np.corrcoef(expected, found)[0, 1] > 0.97
