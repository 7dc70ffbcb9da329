"""Two files of one drive become one stream, whatever the clock did meanwhile."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from tests.onboard.gnss.sentences import rmc
from tpmsd.foundation.errors import InputError
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream

START_S = 1_700_000_000.0


def frame_line(time_s: float, number: int) -> str:
    return f"({time_s:.6f}) can0 0B0#{number:016X}\n"


def sentence_line(time_s: float, utc_s: float) -> str:
    return f"({time_s:.6f}) {rmc(utc_s).decode()}\n"


def write(folder: Path, can: str, gnss: str | None) -> Path:
    (folder / "can.log").write_text(can)
    if gnss is not None:
        (folder / "gnss.nmea").write_text(gnss)
    return folder


def clocked(step_at_s: float, step_s: float, true_s: float) -> float:
    """What a host clock shows that steps by `step_s` at `step_at_s`."""
    return START_S + true_s + (step_s if true_s >= step_at_s else 0.0)


def recorded(
    folder: Path,
    *,
    step_s: float = 0.0,
    step_at_s: float = 10.0,
    frame_period_s: float = 0.02,
    fix_period_s: float = 1.0,
    duration_s: float = 30.0,
) -> Path:
    """A drive whose frames carry their true time in milliseconds, and whose sentences carry it as UTC."""
    frames = [k * frame_period_s for k in range(int(duration_s / frame_period_s))]
    fixes = [0.013 + k * fix_period_s for k in range(int(duration_s / fix_period_s))]
    return write(
        folder,
        "".join(frame_line(clocked(step_at_s, step_s, t), round(1000 * t)) for t in frames),
        "".join(sentence_line(clocked(step_at_s, step_s, t), START_S + t) for t in fixes),
    )


def true_times(folder: Path) -> list[float]:
    """The true time of every item in the order in which the drive gives them."""
    times = []
    for item in FolderStream(folder):
        if isinstance(item, CanFrame):
            times.append(int.from_bytes(item.data, "big") / 1000.0)
        else:
            text = item.line.decode().split(",")[1]
            day_s = START_S % 86400.0
            clock = int(text[:2]) * 3600 + int(text[2:4]) * 60 + float(text[4:])
            times.append(clock - day_s)
    return times


def disorder_s(times: list[float]) -> float:
    """How far the worst item comes too late."""
    latest, worst = times[0], 0.0
    for t in times:
        latest = max(latest, t)
        worst = max(worst, latest - t)
    return worst


def test_files_are_merged_by_time(tmp_path: Path) -> None:
    """Frames and sentences of an ordinary drive come strictly in the order of their stamps, none missing."""
    times = true_times(recorded(tmp_path))
    assert 1530 == len(times)
    assert times == sorted(times)


@pytest.mark.parametrize("step_s", [-3600.0, -100.0, -5.0, -1.5, -0.7, -0.3, 0.4, 20.0, 3600.0])
@pytest.mark.parametrize("fix_period_s", [0.1, 1.0])
def test_a_step_of_the_clock_does_not_tear_the_files_apart(
    tmp_path: Path, step_s: float, fix_period_s: float
) -> None:
    """However the clock steps, also by less than a slow receiver shows, no item comes later than two of the
    receiver's periods; a set-back too small to be taken for a step delays by its own length."""
    times = true_times(recorded(tmp_path, step_s=step_s, fix_period_s=fix_period_s))
    assert 1500 + int(30 / fix_period_s) == len(times)
    assert disorder_s(times) <= (2 * fix_period_s if abs(step_s) > 0.5 else abs(step_s)) + 1e-6


def test_two_steps_back_are_survived(tmp_path: Path) -> None:
    """A clock that steps back twice is followed twice, and both files' steps are counted."""

    def host(t: float) -> float:
        return START_S + t - (1000.0 if t >= 10.0 else 0.0) - (500.0 if t >= 20.0 else 0.0)

    can = "".join(frame_line(host(k / 50), 20 * k) for k in range(1500))
    gnss = "".join(sentence_line(host(k / 5 + 0.003), START_S + k / 5 + 0.003) for k in range(150))
    drive = FolderStream(write(tmp_path, can, gnss))
    assert 1650 == len(list(drive))
    assert (2, 2) == (drive.counts["can clock steps"], drive.counts["gnss clock steps"])
    assert disorder_s(true_times(tmp_path)) <= 0.21


def test_a_step_while_the_receiver_was_silent(tmp_path: Path) -> None:
    """A step that happens in a gap of one file does not hold the rest of the other up."""
    can = "".join(frame_line(clocked(10, -30.0, k / 50), 20 * k) for k in range(3000))
    fixes = [t / 5 + 0.003 for t in range(300) if not 8.0 < t / 5 < 50.0]
    gnss = "".join(sentence_line(clocked(10, -30.0, t), START_S + t) for t in fixes)
    times = true_times(write(tmp_path, can, gnss))
    assert 3000 + len(fixes) == len(times)
    assert disorder_s(times) <= 0.5


@pytest.mark.parametrize("damaged", [0, 1, 700, 1499])
@pytest.mark.parametrize("stamp_s", [0.0, START_S - 86400.0, START_S + 9e8, START_S + 500.0])
def test_a_damaged_stamp_is_left_out(tmp_path: Path, damaged: int, stamp_s: float) -> None:
    """One frame with a stamp from elsewhere, also the first or the last, moves nothing else."""
    recorded(tmp_path)
    lines = (tmp_path / "can.log").read_text().splitlines(keepends=True)
    lines[damaged] = frame_line(stamp_s, 20 * damaged)
    (tmp_path / "can.log").write_text("".join(lines))
    times = true_times(tmp_path)
    kept = [t for t in times if t != 20 * damaged / 1000.0]
    assert len(kept) >= 1528
    assert kept == sorted(kept)


def test_two_damaged_stamps_in_a_row(tmp_path: Path) -> None:
    """Two bad stamps together, which no neighbour contradicts, still leave the rest of the drive in order."""
    recorded(tmp_path)
    lines = (tmp_path / "can.log").read_text().splitlines(keepends=True)
    lines[700], lines[701] = frame_line(START_S + 5000.0, 14000), frame_line(START_S + 9000.0, 14020)
    (tmp_path / "can.log").write_text("".join(lines))
    kept = true_times(tmp_path)
    assert 1528 == len(kept)
    assert kept == sorted(kept)


@pytest.mark.parametrize("count", [2, 3, 5, 6, 12])
def test_stamps_far_apart_are_all_kept(count: int, tmp_path: Path) -> None:
    """A log of a line every 30 s, such as marks of a driver, loses neither its first line nor any other."""
    stamps = [START_S + 30.0 * k for k in range(count)]
    can = "".join(frame_line(t, round(1000.0 * (t - START_S))) for t in stamps)
    gnss = "".join(sentence_line(t + 10.0, t + 10.0) for t in stamps)
    drive = FolderStream(write(tmp_path, can, gnss))
    items = list(drive)

    assert sorted([*stamps, *(t + 10.0 for t in stamps)]) == [item.time_s for item in items]
    assert not drive.counts


def test_a_drive_without_receiver(tmp_path: Path) -> None:
    """No gnss.nmea is a drive of frames alone."""
    write(tmp_path, "".join(frame_line(START_S + k, k) for k in range(5)), None)
    drive = FolderStream(tmp_path)
    assert (5, 0.0) == (len(list(drive)), drive.span_s())


def test_compressed_files(tmp_path: Path) -> None:
    """can.log.gz and gnss.nmea.gz are the same drive as their plain forms."""
    recorded(tmp_path)
    plain = list(FolderStream(tmp_path))
    for name in ("can.log", "gnss.nmea"):
        path = tmp_path / name
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    assert plain == list(FolderStream(tmp_path))


def test_bad_lines_are_counted_and_the_first_is_named(tmp_path: Path) -> None:
    """Lines that are no frames are skipped, counted, and the first is told with its place."""
    recorded(tmp_path)
    lines = (tmp_path / "can.log").read_text().splitlines(keepends=True)
    lines[3] = "(17000\n"
    lines[9] = "\x00\x01\x02 nonsense\n"
    (tmp_path / "can.log").write_text("".join(lines))
    drive = FolderStream(tmp_path)
    assert 1528 == len(list(drive))
    assert 2 == drive.counts["can bad lines"]
    assert drive.first_bad["can"].startswith(f"{tmp_path / 'can.log'}:4: ")


def test_no_log_at_all(tmp_path: Path) -> None:
    """A folder without a CAN log is named with what was looked for."""
    with pytest.raises(InputError, match=r"no CAN log; looked for can\.log"):
        FolderStream(tmp_path)


@pytest.mark.parametrize(("pause_s", "kept"), [(30.0, True), (59.0, True), (61.0, False), (-30.0, False)])
def test_a_lone_first_line_before_a_pause_is_kept(pause_s: float, kept: bool, tmp_path: Path) -> None:
    """The time known before the recorder paused is its first mark; a stamp from elsewhere is none."""
    first = START_S - pause_s + 0.02
    can = frame_line(first, 0) + "".join(frame_line(START_S + 0.02 * k, k) for k in range(1, 9))
    drive = FolderStream(write(tmp_path, can, None))

    assert kept == (first in [item.time_s for item in drive])
    assert ({} if kept else {"can damaged stamps": 1}) == dict(drive.counts)
