"""The summary: the verdict first, in sentences that say what was and what was not watched."""

from __future__ import annotations

import math

import pytest

from tests.offline.report.drives import MONITOR, START_S, VEHICLE, Drive, alarm, puncture
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.offline.report.replay_summary import replay_summary
from tpmsd.offline.report.wording import drive_time
from tpmsd.onboard.monitor.records import AlarmKind, WheelState
from tpmsd.onboard.sources.events import SourceFault


def lines(drive: Drive, elapsed_s: float = 2.0) -> list[str]:
    """The summary of a drive, line by line."""
    return replay_summary(drive.record().result(elapsed_s)).split("\n")


def test_a_puncture_is_the_first_thing_said() -> None:
    """The first line names the wheel, the finding, its size and both times."""
    assert (
        "Rear left tyre is losing air: radius down 1.51 mm from its baseline. "
        "Announced at 5:41 (host time 1719821141.200)."
    ) == lines(puncture())[0]


def test_a_quiet_drive_says_what_its_silence_is_worth() -> None:
    """No alarm comes with the wheels that were watched and for how long."""
    assert (
        "No alarm. Front left, front right, rear left and rear right were monitored, for 2:00 or more."
    ) == lines(Drive(duration_s=180.0))[0]


def test_silence_without_monitoring_is_not_sold_as_good_news() -> None:
    """A drive too short to learn a baseline says that nothing was monitored, and why."""
    text = lines(Drive(duration_s=45.5))

    assert "No alarm, but no wheel was monitored either." == text[0]
    assert (
        "Not monitored: front left, front right, rear left and rear right (the baseline was still being "
        "learned, 75% of it after 45 s of steady driving; 60 s are needed)."
    ) in text


def test_wheels_that_are_not_on_the_bus_are_named() -> None:
    """The rear pair alone: the front wheels are named as not monitored."""
    text = lines(
        Drive(
            duration_s=90.0,
            state=lambda t, wheel: WheelState.MONITORING if wheel[0] == "r" else WheelState.UNAVAILABLE,
        )
    )

    assert "No alarm. Rear left and rear right were monitored, for 1:30 or more." == text[0]
    assert "Not monitored: front left and front right (no usable signal on the bus)." in text
    assert not any(line.startswith("front left ") for line in text), "no row for a wheel nobody saw"


def test_an_alarm_that_was_cleared_is_reported_as_such() -> None:
    """The verdict keeps the alarm and says that it did not last; the list has both changes."""
    text = lines(
        Drive(
            duration_s=200.0,
            events={
                1200: (alarm(120.1, AlarmKind.RADIUS_DEVIATION, "fr", reason="radius up 2.6 mm."),),
                1500: (alarm(150.1, AlarmKind.RADIUS_DEVIATION, "fr", "cleared"),),
            },
        )
    )

    assert (
        "Front right tyre has changed its rolling radius: radius up 2.6 mm. Announced at 2:00 "
        "(host time 1719820920.100). It was cleared before the end of the drive."
    ) == text[0]
    listed = text[text.index("Alarms:") + 1 :][:2]
    assert ["raised", "cleared"] == [line.split()[2] for line in listed]
    assert ["2:00", "2:30"] == [line.split()[0] for line in listed]


def test_the_gravest_alarm_comes_first_and_a_repeated_one_once() -> None:
    """Deflation before malfunction whatever came first; an alarm that came back is one finding."""
    text = lines(
        Drive(
            duration_s=200.0,
            events={
                700: (alarm(70.0, AlarmKind.MALFUNCTION, None, deviation_m=math.nan, reason="no fix"),),
                1200: (alarm(120.0),),
                1300: (alarm(130.0, state="cleared"),),
                1500: (alarm(150.0),),
            },
        )
    )

    assert text[0].startswith("Rear left tyre is losing air")
    assert "2:00" in text[0]
    assert "cleared" not in text[0]
    assert text[1].startswith("Monitoring has failed: no fix. Announced at 1:10")
    assert "" == text[2]


def test_the_table_has_the_numbers_of_each_wheel() -> None:
    """Radius, deviation, change and probability, in millimetres with one standard deviation."""
    (row,) = [line for line in lines(puncture()) if line.startswith("rear left ")]

    assert "rear left alarm 314.20 -1.80 +- 0.10 -2.20 +- 0.10 9:00 1.000" == " ".join(row.split())


def test_the_inputs_health_and_the_speed_of_the_replay_are_reported() -> None:
    """Driving time, distance, fixes, outages and faults, each counted."""
    text = lines(puncture())

    assert any(line.startswith("Drive evening-drive: 10:00, 12.30 km, 9:30 of it moving") for line in text)
    assert any(line.endswith("replayed at 300 times real time.") for line in text)
    assert (
        "GNSS: 5671 fixes, once more than 5 s without a usable one (longest 30 s); rejected "
        "before the estimate: 1 checksum."
    ) in text
    assert "CAN: rejected before the estimate: 21 lost." in text


def test_faults_of_an_input_are_sorted_by_their_number() -> None:
    """The most frequent kind comes first."""
    faults = {k: (SourceFault(START_S, "can", "lost"), SourceFault(START_S, "can", "late")) for k in (1, 2)}
    faults[3] = (SourceFault(START_S, "can", "lost"),)
    text = lines(Drive(duration_s=90.0, faults=faults))

    assert "CAN: rejected before the estimate: 3 lost, 2 late." in text


def test_no_fix_in_the_whole_drive_is_a_reason() -> None:
    """Without the receiver no radius is learned, and the summary says why."""
    text = lines(Drive(duration_s=30.0, has_fix=lambda t: False))

    assert any(line.endswith("(no GNSS fix in the whole drive).") for line in text)
    assert "GNSS: no fix in the whole drive." in text


def test_a_pause_of_the_recording_is_reported() -> None:
    """Gaps between ticks are counted and summed."""
    text = lines(Drive(duration_s=90.0, pauses={300: 12.0, 500: 3.0}), elapsed_s=125.0)

    assert any(
        "replayed at 0.8 times real time. The recording pauses twice, 15.0 s in all." in x for x in text
    )


def test_an_empty_drive_has_a_summary() -> None:
    """Not one tick: said in words, not with an error."""
    text = replay_summary(ReplayRecorder("empty", VEHICLE, MONITOR).result(math.nan))

    assert text.startswith("No alarm, but no wheel was monitored either.")
    assert "Not monitored: no wheel signal of the configuration was usable on the bus." in text


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (0.0, "0:00"),
        (59.4, "0:59"),
        (59.6, "1:00"),
        (3599.6, "1:00:00"),
        (7384.0, "2:03:04"),
        (-5.0, "-0:05"),
        (-0.2, "0:00"),
        (math.nan, "-"),
        (math.inf, "-"),
    ],
)
def test_drive_time_rounds_to_whole_seconds(seconds: float, expected: str) -> None:
    """Minutes and seconds, hours where needed, a dash for what is unknown."""
    assert expected == drive_time(seconds)
