from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.sources.gnss.nmea_clock import ReceiverClock, nearest_day

DAY = 86400.0
JULY_11 = 19915  # days from 1970-01-01 to 2024-07-11
HOST = JULY_11 * DAY + 60000.0


def test_date_and_time_of_day():
    """A date and a time of day are Unix seconds."""
    assert JULY_11 * DAY + 12.5 == ReceiverClock().resolve(12.5, JULY_11, HOST)


def test_no_time():
    """Without a time of day there is no time."""
    assert math.isnan(ReceiverClock().resolve(math.nan, JULY_11, HOST))


def test_before_any_date_the_arrival_tells_the_day():
    """Just after midnight on the host, a time just before midnight is yesterday's."""
    assert JULY_11 * DAY - 1.0 == ReceiverClock().resolve(DAY - 1.0, None, JULY_11 * DAY + 2.0)


@pytest.mark.parametrize("host_s", [5.0, HOST, HOST + 40 * DAY])
def test_midnight_without_a_date(host_s: float):
    """Times of day without a date run on over midnight, whatever the host clock says."""
    clock = ReceiverClock()
    clock.resolve(DAY - 0.2, JULY_11, host_s)
    times = [clock.resolve(t, None, host_s) for t in (DAY - 0.1, 0.0, 0.1)]
    assert pytest.approx([(JULY_11 + 1) * DAY + t for t in (-0.1, 0.0, 0.1)], abs=1e-6) == times


def test_leap_second():
    """Second 60 has the Unix time of the second that follows, as POSIX has it, on either day's date."""
    clock = ReceiverClock()
    clock.resolve(DAY - 1.0, 17166, HOST)  # 2016-12-31
    assert 17167 * DAY + 0.5 == clock.resolve(DAY + 0.5, None, HOST)
    assert 17167 * DAY + 0.5 == clock.resolve(DAY + 0.5, 17166, HOST)
    assert 17167 * DAY == clock.resolve(0.0, None, HOST)


@pytest.mark.parametrize("periods", [1, 2, -1])
def test_week_rollover(periods: int):
    """A date 1024 weeks off the host's is put right."""
    clock = ReceiverClock()
    wrong_day = JULY_11 - periods * 7168
    assert JULY_11 * DAY + 60000.0 == clock.resolve(60000.0, wrong_day, HOST + 3.0)
    assert periods == clock.rollovers


@pytest.mark.parametrize("host_s", [100.0, HOST + 5 * DAY, HOST - 300 * DAY])
def test_a_host_that_is_just_wrong_corrects_nothing(host_s: float):
    """Only a difference of whole 1024 weeks is the receiver's error; any other date is accepted."""
    clock = ReceiverClock()
    assert JULY_11 * DAY + 60000.0 == clock.resolve(60000.0, JULY_11, host_s)
    assert 0 == clock.rollovers


def test_rollover_holds_for_sentences_without_a_date():
    """After a correction, times of day stay on the corrected date."""
    clock = ReceiverClock()
    clock.resolve(60000.0, JULY_11 - 7168, HOST)
    assert JULY_11 * DAY + 60000.1 == clock.resolve(60000.1, None, HOST)


def test_undated_receiver_survives_a_host_step_of_hours():
    """Without any date, a host clock that steps by an hour does not move the receiver's day."""
    clock = ReceiverClock()
    clock.resolve(43300.0, None, JULY_11 * DAY + 43300.0)
    assert JULY_11 * DAY + 43301.0 == clock.resolve(43301.0, None, JULY_11 * DAY + 43301.0 - 3 * 3600)


@settings(derandomize=True, deadline=None)
@given(st.floats(0, 86400), st.floats(-1e10, 1e10))
def test_nearest_day_is_within_half_a_day(time_of_day_s: float, reference_s: float):
    """The nearest day's time is at most twelve hours away and has the time of day."""
    found = nearest_day(time_of_day_s, reference_s)
    assert abs(found - reference_s) <= DAY / 2 + 1e-5
    assert pytest.approx(0.0, abs=1e-5) == math.remainder(found - time_of_day_s, DAY)
