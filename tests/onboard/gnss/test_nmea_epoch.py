from __future__ import annotations

import math
from dataclasses import astuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.gnss.sentences import gga, gst, nmea, rmc, vtg, zda
from tpmsd.onboard.sources.events import Event, GnssFix, SourceFault
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler

T = 1720716104.0  # 2024-07-11 16:41:44
Timed = tuple[float, bytes]


def run(lines: list[Timed], assembler: NmeaAssembler | None = None) -> list[Event]:
    assembler = assembler or NmeaAssembler()
    events = [event for time_s, line in lines for event in assembler.feed(time_s, line)]
    return events + assembler.flush()


def fixes(events: list[Event]) -> list[GnssFix]:
    return [event for event in events if isinstance(event, GnssFix)]


def faults(events: list[Event]) -> list[tuple[float, str]]:
    return [(event.time_s, event.kind) for event in events if isinstance(event, SourceFault)]


def printable(events: list[Event]) -> list[str]:
    """NaN is not equal to itself, but prints the same."""
    return [repr(astuple(event)) for event in events]


def along(step: int) -> tuple[float, float]:
    """Positions that move on."""
    return 48.0 + 1e-5 * step, 11.0


def test_one_epoch_of_all_sentences():
    """RMC, GGA, VTG, GST and ZDA of one instant make one fix with all that they say."""
    at = (48.25, 11.5)
    lines = [rmc(T, at=at, speed_mps=20.0, course_deg=45.0), gga(T, at=at, quality=2, hdop=0.8)]
    lines += [vtg(20.0), gst(T, 0.6, 0.8), zda(T)]
    events = run([(T + 0.05 + 0.01 * i, line) for i, line in enumerate(lines)])
    assert 1 == len(events)
    fix = fixes(events)[0]
    assert (T + 0.05, T, 2, 0.8) == (fix.arrival_s, fix.utc_s, fix.quality, fix.hdop)
    assert pytest.approx(at, abs=1e-9) == (fix.latitude_deg, fix.longitude_deg)
    assert pytest.approx((547.5, math.sqrt(0.5))) == (fix.altitude_m, fix.position_std_m)
    assert pytest.approx((20.0, math.pi / 4), abs=1e-5) == (fix.speed_mps, fix.course_rad)


def test_vtg_before_its_gga():
    """VTG that comes 5 ms before its GGA joins that epoch, not the one 95 ms before."""
    lines: list[Timed] = []
    for i in range(10):
        lines += [(T + 0.1 * i + 0.020, vtg(10.0 + i)), (T + 0.1 * i + 0.025, gga(T + 0.1 * i, at=along(i)))]
    got = fixes(run(lines))
    # The first interval is not known before the second GGA, so judge from the third epoch on.
    assert pytest.approx([10.0 + i for i in range(2, 10)]) == [fix.speed_mps for fix in got[2:]]
    assert pytest.approx([T + 0.1 * i for i in range(10)], abs=1e-6) == [fix.utc_s for fix in got]


def test_vtg_after_its_rmc():
    """VTG that comes after GGA joins the epoch before it, also on a slow line."""
    lines: list[Timed] = []
    for i in range(6):
        lines += [(T + i + 0.1, gga(T + i, at=along(i))), (T + i + 0.3, vtg(10.0 + i))]
    assert pytest.approx([10.0 + i for i in range(6)]) == [fix.speed_mps for fix in fixes(run(lines))]


def test_sentences_of_no_use_keep_a_burst_together():
    """Satellite lists between the sentences of an epoch, half a second in all, do not split it."""
    gsv = nmea("GPGSV,1,1,00")
    lines: list[Timed] = []
    for i in range(4):
        burst = [gga(T + i, at=along(i)), gsv, gsv, gsv, vtg(10.0 + i)]
        lines += [(T + i + 0.2 * n * 0.8, line) for n, line in enumerate(burst)]
    got = fixes(run(lines))
    assert pytest.approx([10.0, 11.0, 12.0, 13.0]) == [fix.speed_mps for fix in got]


def test_plain_lines_with_one_stamp_per_epoch():
    """Where the time stamps are the sentences' own UTC, epochs are still told apart."""
    for order in ((rmc, gga), (gga, rmc)):
        lines = [(T + 0.1 * i, make(T + 0.1 * i, at=along(i))) for i in range(5) for make in order]
        got = fixes(run(lines))
        assert pytest.approx([T + 0.1 * i for i in range(5)], abs=1e-6) == [fix.utc_s for fix in got]
        assert pytest.approx([20.0] * 5, abs=1e-5) == [fix.speed_mps for fix in got]


def test_advance_ends_an_epoch_after_its_silence():
    """At 10 Hz an epoch is over 30 ms after its last sentence, and not before."""
    assembler = NmeaAssembler()
    for i in range(3):
        assembler.feed(T + 0.1 * i, gga(T + 0.1 * i, at=along(i)))
    assert pytest.approx(T + 0.23, abs=1e-6) == assembler.deadline_s
    assert [] == assembler.advance(T + 0.2299)
    assert pytest.approx(T + 0.2, abs=1e-6) == fixes(assembler.advance(T + 0.2301))[0].utc_s
    assert math.inf == assembler.deadline_s
    assert [] == assembler.advance(T + 9.0)


@pytest.mark.parametrize(
    ("interval", "gap"), [(1.0, 0.25), (0.2, 0.06), (0.1, 0.03), (0.05, 0.02), (0.01, 0.02)]
)
def test_silence_follows_the_rate(interval: float, gap: float):
    """The silence that ends an epoch is 0.3 of the interval within 20 and 250 ms, despite lost epochs."""
    assembler = NmeaAssembler()
    for i in (0, 1, 2, 5, 6, 7):
        assembler.feed(T + interval * i, gga(T + interval * i, at=along(i)))
    assert pytest.approx(gap, abs=1e-5) == assembler.deadline_s - (T + 7 * interval)


def test_over_midnight_on_time_of_day_alone():
    """GGA has no date: with one date before midnight, UTC runs on through it."""
    midnight = 1720742400.0
    lines = [(midnight - 0.4, rmc(midnight - 0.4, at=along(-4)))]
    lines += [(midnight + 0.1 * i, gga(midnight + 0.1 * i, at=along(i))) for i in range(-3, 4)]
    got = [fix.utc_s for fix in fixes(run(lines))]
    assert pytest.approx([midnight + 0.1 * i for i in range(-4, 4)], abs=1e-6) == got


def test_week_rollover_is_corrected_and_reported_once():
    """A receiver that is 1024 weeks behind the host is put right and reported once."""
    behind = 1024 * 7 * 86400.0
    events = run([(T + i + 0.05, rmc(T + i - behind, at=along(i))) for i in range(5)])
    assert [T + i for i in range(5)] == [fix.utc_s for fix in fixes(events)]
    assert [(T + 0.05, "week_rollover")] == faults(events)


@pytest.mark.parametrize(
    "lost",
    [
        [rmc(T, status="V", mode="N")],
        [rmc(T), gga(T, quality=0)],
        [rmc(T, status="V"), gga(T)],
        [gga(T), vtg(20.0, mode="N")],
        [gga(T, at=(0.0, 0.0), quality=0)],
        [gga(T, quality="")],
        [nmea("GNRMC,164144.00,V,,,,,,,110724,,,N")],
    ],
)
def test_no_solution_is_an_epoch_without_position(lost: list[bytes]):
    """If any sentence says that there is no solution, the fix has its UTC but no position and no speed."""
    events = run([(T + 0.1, line) for line in lost])
    assert [(T + 0.1, "no_fix")] == faults(events)
    fix = fixes(events)[0]
    assert (T, 0) == (fix.utc_s, fix.quality)
    silent = (fix.latitude_deg, fix.longitude_deg, fix.position_std_m, fix.speed_mps, fix.course_rad)
    assert all(math.isnan(value) for value in silent)


def test_no_fix_is_reported_once_per_episode():
    """A tunnel is one fault, the next tunnel another."""
    statuses = "AAVVVVAAVVA"
    lines = [(T + i, rmc(T + i, at=along(i), status=status)) for i, status in enumerate(statuses)]
    assembler = NmeaAssembler()
    events = run(lines, assembler)
    assert [(T + 2, "no_fix"), (T + 8, "no_fix")] == faults(events)
    assert (6, 11) == (assembler.counts["no_fix"], assembler.counts["fixes"])
    assert [status == "V" for status in statuses] == [math.isnan(f.latitude_deg) for f in fixes(events)]


def test_null_island_is_no_position():
    """Exactly 0/0 is no position, even when it is called valid; right beside it is one."""
    got = fixes(run([(T, gga(T, at=(0.0, 0.0))), (T + 1, gga(T + 1, at=(0.0, 1e-6)))]))
    assert [True, False] == [math.isnan(fix.latitude_deg) for fix in got]


def test_impossible_position_is_reported():
    """A latitude of 91 degrees is a fault, and the epoch has no position."""
    events = run([(T, gga(T, at=(91.0, 11.0)))])
    assert [(T, "range")] == faults(events)
    assert math.isnan(fixes(events)[0].latitude_deg)


@pytest.mark.parametrize(("speed", "known"), [(0.49, False), (0.51, True)])
def test_course_at_a_walk(speed: float, known: bool):
    """Below half a metre per second the course is noise and left out."""
    fix = fixes(run([(T, rmc(T, speed_mps=speed))]))[0]
    assert known == math.isfinite(fix.course_rad)


def test_empty_course_and_speed():
    """Empty speed and course are NaN; the position stays."""
    fix = fixes(run([(T, rmc(T, speed_mps=None, course_deg=None))]))[0]
    assert [True, True, False] == [math.isnan(v) for v in (fix.speed_mps, fix.course_rad, fix.latitude_deg)]


def test_frozen_position():
    """The fifth identical position at speed is a fault; positions are left out until it moves again."""
    places = [0, 1, 2, 3, 3, 3, 3, 3, 3, 4, 5]
    lines = [(T + 0.1 * i, rmc(T + 0.1 * i, at=along(p))) for i, p in enumerate(places)]
    events = run(lines)
    assert pytest.approx([T + 0.7]) == [time for time, _ in faults(events)]
    assert ["frozen"] == [kind for _, kind in faults(events)]
    missing = [math.isnan(fix.latitude_deg) for fix in fixes(events)]
    assert [False] * 7 + [True] * 2 + [False] * 2 == missing
    assert pytest.approx([20.0] * 11, abs=1e-5) == [fix.speed_mps for fix in fixes(events)]


def test_leap_is_left_out():
    """One position out of reach, or two, are a fault; the way goes on from where it was."""
    places = [0, 1, 2, 50000, 50001, 5, 6, -90000, 8, 9]
    events = run([(T + i, rmc(T + i, at=along(p))) for i, p in enumerate(places)])
    assert [(T + 3, "leap"), (T + 7, "leap")] == faults(events)
    missing = [math.isnan(fix.latitude_deg) for fix in fixes(events)]
    assert [abs(p) > 1000 for p in places] == missing


def test_leap_is_believed_in_the_end():
    """Where three positions in a row are out of reach together, they are right and the first was wrong."""
    places = [90000, 1, 2, 3, 4, 5]
    got = fixes(run([(T + i, rmc(T + i, at=along(p))) for i, p in enumerate(places)]))
    assert [False, True, True, False, False, False] == [math.isnan(fix.latitude_deg) for fix in got]


def test_far_drive_after_a_long_silence_is_no_leap():
    """After an hour without fixes the car may be a hundred kilometres on, over the date line too."""
    lines = [(T, rmc(T, at=(48.0, 179.9))), (T + 3600, rmc(T + 3600, at=(48.5, -179.0)))]
    assert [] == faults(run(lines))


def test_standing_is_not_frozen():
    """A car that stands has the same position for as long as it likes."""
    assert [] == faults(run([(T + i, rmc(T + i, speed_mps=1.0)) for i in range(20)]))


def test_gst_lasts_five_seconds():
    """A GST counts for its own epoch and for those within five seconds; then the quality decides."""
    lines = [(T, gst(T, 0.3, 0.3))] + [(T + i, gga(T + i, at=along(i), hdop=1.0)) for i in range(8)]
    got = [fix.position_std_m for fix in fixes(run(lines))]
    assert pytest.approx([0.3] * 5 + [1.5] * 3) == got


def test_speed_alone():
    """A receiver that sends only VTG gives speeds without time or place."""
    got = fixes(run([(T + i, vtg(10.0 + i, course_deg=180.0)) for i in range(3)]))
    assert pytest.approx([10.0, 11.0, 12.0]) == [fix.speed_mps for fix in got]
    assert all(math.isnan(fix.utc_s) and math.isnan(fix.latitude_deg) for fix in got)
    assert [T, T + 1, T + 2] == [fix.arrival_s for fix in got]


def test_date_alone_is_no_fix():
    """ZDA tells the date and nothing of the motion: no fix comes of it."""
    assert [] == run([(T, zda(T)), (T + 1, zda(T + 1))])


def test_broken_sentences_are_reported_and_cost_nothing_else():
    """A wrong checksum and garbage are one fault each; the epoch keeps what the other sentences say."""
    broken = rmc(T)[:-1] + b"!"
    wrong = rmc(T).replace(b"A,48", b"A,49")
    assembler = NmeaAssembler()
    events = run([(T, gga(T)), (T + 0.01, broken), (T + 0.02, wrong), (T + 0.03, vtg(12.0))], assembler)
    assert [(T + 0.01, "garbage"), (T + 0.02, "checksum")] == faults(events)
    assert [12.0] == [round(fix.speed_mps, 4) for fix in fixes(events)]
    assert (1, 1, 0) == tuple(assembler.counts[kind] for kind in ("garbage", "checksum", "RMC"))


def test_sentences_without_checksum_are_counted():
    """Sentences without a checksum are used, and counted."""
    assembler = NmeaAssembler()
    got = fixes(run([(T, gga(T).split(b"*")[0])], assembler))
    assert pytest.approx(48.0) == got[0].latitude_deg
    assert 1 == assembler.counts["no_checksum"]


def test_missing_checksum_is_damage_where_checksums_are_the_rule():
    """After ten sentences with checksums, one without is garbage: its damage might be anywhere."""
    assembler = NmeaAssembler()
    lines = [(T + i, gga(T + i, at=along(i))) for i in range(10)]
    events = run([*lines, (T + 10, gga(T + 10, at=(4.8, 11.0)).split(b"*")[0])], assembler)
    assert [(T + 10, "garbage")] == faults(events)
    assert (10, 1, 1) == tuple(assembler.counts[kind] for kind in ("fixes", "garbage", "no_checksum"))


def test_every_line_twice():
    """A log in which each line was written twice gives each epoch once, and one fault."""
    lines = [(T + i, line) for i in range(6) for line in (rmc(T + i, at=along(i)), gga(T + i, at=along(i)))]
    doubled = [timed for timed in lines for _ in range(2)]
    events = run(doubled)
    assert printable(run(lines)) == printable([e for e in events if isinstance(e, GnssFix)])
    assert [(T, "repeated")] == faults(events)


def test_same_epoch_from_two_talkers_counts_once():
    """A second talker's position of the same instant is left out of the estimate."""
    lines = [(T + i, gga(T + i, at=along(i), talker=talker)) for i in range(4) for talker in ("GN", "GP")]
    events = run(lines)
    assert [T, T + 1, T + 2, T + 3] == [fix.utc_s for fix in fixes(events)]
    assert [(T, "repeated")] == faults(events)


def test_late_speed_of_an_epoch_that_was_split():
    """If a slow line splits an epoch, its speed still comes, but its position only once."""
    lines: list[Timed] = []
    for i in range(5):
        lines += [(T + i, gga(T + i, at=along(i))), (T + i + 0.6, rmc(T + i, at=along(i)))]
    events = run(lines)
    assert [] == faults(events)
    assert [False, True] * 5 == [math.isnan(fix.latitude_deg) for fix in fixes(events)]
    assert [True, False] * 5 == [math.isnan(fix.speed_mps) for fix in fixes(events)]


def test_leap_second_is_no_repetition():
    """Second 60 and the second after it share a Unix time and are both epochs."""
    lines = []
    for i, text in enumerate(["235959", "235960", "000000", "000001"]):
        body = f"GNGGA,{text}.00,4800.00{i}0000,N,01100.0000000,E,1,12,0.9,500,M,47,M,,"
        lines.append((1483228799.0 + i, nmea(body)))
    got = fixes(run(lines))
    assert [1483228799.0, 1483228800.0, 1483228800.0, 1483228801.0] == [fix.utc_s for fix in got]
    assert not any(math.isnan(fix.latitude_deg) for fix in got)


def test_a_sentence_at_the_deadline_still_belongs_to_the_epoch():
    """At 1 Hz VTG a quarter of a second after GGA is of that epoch, and a millisecond later of none."""
    for late_s, speeds in ((0.25, [10.0]), (0.251, [])):
        lines = [(float(i), gga(T + i, at=along(i))) for i in range(4)]
        lines.append((3.0 + late_s, vtg(10.0)))
        said = [fix.speed_mps for fix in fixes(run(lines)) if fix.latitude_deg > 0.0]
        assert speeds == pytest.approx([speed for speed in said if not math.isnan(speed)])


def test_a_sentence_damaged_on_its_way_keeps_the_epoch_open_and_noise_does_not():
    """A wrong checksum is a sentence of the epoch: VTG 0.2 s after it joins in; not so after noise."""
    for kind, middle, speeds in (("checksum", b"$GPGSV,1,1,00*00", [10.0]), ("garbage", b"\xff\x00#", [])):
        lines = [(float(i), gga(T + i, at=along(i))) for i in range(4)]
        lines += [(3.2, middle), (3.4, vtg(10.0))]
        events = run(lines)
        said = [fix.speed_mps for fix in fixes(events) if fix.latitude_deg > 0.0]
        assert [(3.2, kind)] == faults(events)
        assert speeds == pytest.approx([speed for speed in said if not math.isnan(speed)])


def test_a_clock_that_steps_back_ends_the_epoch_and_jitter_does_not():
    """VTG stamped an hour before its GGA is of another epoch; one stamped 0.2 s before it is of the same."""
    for step_s, speeds in ((0.2, [10.0]), (3600.0, [])):
        lines = [(float(i), gga(T + i, at=along(i))) for i in range(4)]
        lines.append((3.0 - step_s, vtg(10.0)))
        said = [fix.speed_mps for fix in fixes(run(lines)) if fix.latitude_deg > 0.0]
        assert speeds == pytest.approx([speed for speed in said if not math.isnan(speed)])


def test_host_clock_steps_back():
    """A host clock that is set back an hour ends the epoch and loses none."""
    lines = [(T + 0.1 * i - (3600 if i > 2 else 0), gga(T + 0.1 * i, at=along(i))) for i in range(6)]
    got = [fix.utc_s for fix in fixes(run(lines))]
    assert pytest.approx([T + 0.1 * i for i in range(6)], abs=1e-6) == got


LINES = st.one_of(
    st.builds(lambda i, k: k(T + 0.1 * i, at=along(i)), st.integers(0, 40), st.sampled_from([rmc, gga])),
    st.builds(lambda i: vtg(5.0 + i), st.integers(0, 20)),
    st.builds(lambda i: gst(T + 0.1 * i, 0.5, 0.5), st.integers(0, 40)),
    st.builds(lambda i: zda(T + 0.1 * i), st.integers(0, 40)),
    st.sampled_from([nmea("GPGSV,1,1,00"), nmea("PUBX,1"), rmc(T, status="V"), b"$GNRMC,broken*00", b"\xff"]),
    st.binary(max_size=30),
)
GAPS = st.sampled_from([0.0, 0.001, 0.005, 0.02, 0.0299, 0.03, 0.0301, 0.06, 0.1, 0.25, 0.26, 1.0, 30.0])


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.lists(st.tuples(GAPS, LINES, st.lists(st.floats(0, 1), max_size=4)), max_size=30))
def test_advance_changes_nothing_but_the_moment(steps: list[tuple[float, bytes, list[float]]]):
    """However often `advance` is called between the lines, the events and counts are the same."""
    quiet, busy = NmeaAssembler(), NmeaAssembler()
    expected: list[Event] = []
    actual: list[Event] = []
    now = T
    for gap, line, moments in steps:
        for moment in sorted(moments):
            actual += busy.advance(now + gap * moment)
        now += gap
        expected += quiet.feed(now, line)
        actual += busy.feed(now, line)
    expected += quiet.flush()
    actual += busy.flush()
    assert printable(expected) == printable(actual)
    assert quiet.counts == busy.counts


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.lists(st.tuples(st.floats(-1e10, 1e10), LINES), max_size=40))
def test_any_lines_at_any_time(lines: list[Timed]):
    """Any lines at any times, also backwards, never raise, and a position always has a finite noise."""
    assembler = NmeaAssembler()
    for fix in fixes(run(lines, assembler)):
        assert math.isnan(fix.latitude_deg) == math.isnan(fix.position_std_m)
    assert sum(assembler.counts[kind] for kind in ("RMC", "GGA", "VTG", "GST", "ZDA")) <= len(lines)
    assert assembler._burst is None


def test_memory_is_bounded():
    """Thousands of lines of one endless epoch leave one reading of each type behind."""
    assembler = NmeaAssembler()
    for i in range(5000):
        assembler.feed(T + 0.1 * i, gga(T, at=along(i)))
        assembler.feed(T + 0.1 * i, b"$GNRMC,broken*00")
    assert assembler._burst is not None
    assert ["GGA"] == list(assembler._burst.readings)
