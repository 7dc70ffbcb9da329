"""The status document and the table that a driver sees of it."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import re
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd import __version__
from tpmsd.interfaces.cli.status import colour_wanted, show, watch
from tpmsd.interfaces.cli.status_table import render_status
from tpmsd.onboard.estimators.base import RadiusEstimate, RadiusStatement
from tpmsd.onboard.monitor.evidence.detectable import DetectableLoss
from tpmsd.onboard.monitor.records import (
    AlarmEvent,
    AlarmKind,
    LearningReport,
    MonitorReport,
    WheelReport,
    WheelState,
)
from tpmsd.onboard.resonance.watch import ResonanceState, ResonanceStatus
from tpmsd.onboard.sinks.status_document import LoopHealth, SourceHealth, SourceState, build_status

NAN = math.nan
DEFLATION = AlarmEvent(
    1000.0,
    AlarmKind.DEFLATION,
    "rl",
    "raised",
    -0.0032,
    0.0001,
    0.997,
    "lost 3.2 mm against the others",
    pressure_loss=0.31,
)
REPORT = MonitorReport(
    time_s=1190.0,
    wheels=(
        WheelReport("fl", WheelState.MONITORING, 0.0012, 0.00013, 0.00002, 0.00011, 0.01, 0.0),
        WheelReport("fr", WheelState.MONITORING, 0.0004, 0.00013, -0.0009, 0.00011, 0.62, 0.1),
        WheelReport("rl", WheelState.ALARM, -0.0032, 0.0001, -0.0031, 0.0001, 0.999, 1.0),
        WheelReport("rr", WheelState.LEARNING, -0.001, 0.0004, NAN, NAN, NAN, NAN),
    ),
    active=(DEFLATION,),
    events=(),
    learning_fraction=0.4,
    learning=LearningReport(
        "winter", ("default", "winter"), 40.0, ((29, 3), (58, 0)), "accepted", "learning winter again", 2
    ),
)
ESTIMATE = RadiusEstimate(
    time_s=1190.0,
    deviation_m=np.zeros(4),
    covariance_m2=np.eye(4),
    noise_std_m=np.ones(4),
    informative=True,
    informative_s=312.5,
    speed_mps=24.5,
    yaw_rate_radps=0.01,
    east_m=1.0,
    north_m=2.0,
    heading_rad=0.3,
    position_std_m=0.8,
    heading_std_rad=0.01,
    gnss_age_s=math.inf,
    effective_particles=31.5,
    ancestors=17.0,
    between_std_m=2.5e-4,
    stated=RadiusStatement(
        np.array([np.nan, np.nan, 1e-3, -2e-3]), 1e-8 * np.diag([np.nan, np.nan, 1.0, 4.0]), 0.125
    ),
)
LOOP = LoopHealth(uptime_s=3725.0, ticks=37250, missed_deadlines=2)
CAN = SourceHealth(SourceState.OK, "can0", 1234567, {"lost": 3, "checksum": 1}, 0.004, "", {"lost": 1})
GNSS = SourceHealth(SourceState.DOWN, "/dev/ttyACM0", 3600, {"unplugged": 1}, 12.34, "no such device")
LAST_KNOWN = {"rr": (1120.0, REPORT.wheels[3]._replace(change_m=-0.0002, change_std_m=0.0003))}
DOCUMENT = build_status(
    REPORT, loop=LOOP, can=CAN, gnss=GNSS, estimate=ESTIMATE, method="mpf-pn", last_known=LAST_KNOWN
)


def test_the_document_names_the_car_that_has_a_name() -> None:
    """`vehicle` is there with a name of the configuration only."""
    assert "vehicle" not in DOCUMENT
    named = build_status(REPORT, loop=LOOP, can=CAN, gnss=GNSS, vehicle_name="the van")
    assert {"name": "the van"} == named["vehicle"]


def test_the_wheels_that_are_not_watched_are_named_with_the_reason() -> None:
    """A wheel that is learned, one that is lost and one without a signal are each not watched, and why; what
    all four rest on is said."""
    lost = AlarmEvent(
        1.0, AlarmKind.MALFUNCTION, "rl", "raised", NAN, NAN, 1.0, "no usable signal of wheel rl"
    )
    states = (WheelState.MONITORING, WheelState.UNAVAILABLE, WheelState.UNAVAILABLE, WheelState.LEARNING)
    wheels = tuple(wheel._replace(state=state) for wheel, state in zip(REPORT.wheels, states, strict=True))
    report = REPORT._replace(wheels=wheels, active=(lost,))
    off = SourceHealth(SourceState.OFF)
    watch = build_status(report, loop=LOOP, can=off, gnss=off)["watch"]
    assert ["fl"] == watch["watched"]
    assert {
        "fr": "there is no signal of it",
        "rl": "no usable signal of wheel rl",
        "rr": "its normal radius is being learned",
    } == watch["not_watched"]
    assert watch["all_four_rest_on"].startswith("the receiver alone")
    shown = " ".join(render_status(build_status(report, loop=LOOP, can=off, gnss=off)).split())
    assert "not watched: fr (there is no signal of it); rl (no usable signal of wheel rl)" in shown


def test_the_watch_names_the_losses_that_would_not_be_seen() -> None:
    """A loss of 20 % that is beyond sight now is named, in the document and in the table."""
    off = SourceHealth(SourceState.OFF)
    said = {}
    for least in (0.19, 0.31, 1.0):
        losses = partial(DetectableLoss, one_tyre=0.12, all_tyres=least, one_axle=0.15)
        report = REPORT._replace(losses=losses)
        document = build_status(report, loop=LOOP, can=off, gnss=off)
        said[least] = document["watch"]["cannot_see"]
        assert {
            "one_tyre": 12.0,
            "both_tyres_of_an_axle": 15.0,
            "all_tyres_alike": 100 * least,
        } == document["watch"]["smallest_loss_percent"]
        assert bool(said[least]) == ("cannot see now" in render_status(document))
    of_all = "a loss of 20 % of the pressure of all tyres alike"
    assert {0.19: [], 0.31: [f"{of_all} (seen from 31 % on)"], 1.0: [of_all]} == said


def test_the_document_holds_all_in_the_units_it_states() -> None:
    """Every number of the records is found under its name, metres as mm, NaN and infinity as null."""
    assert {
        "version": 1,
        "tpmsd": __version__,
        "time": 1190.0,
        "uptime_s": 3725.0,
        "ticks": 37250,
        "missed_deadlines": 2,
        "learning_fraction": 0.4,
        "baseline": {
            "tyres": "winter",
            "sets": ["default", "winter"],
            "learned_s": 40.0,
            "samples_by_kmh": {"29": 3, "58": 0},
            "reset": "accepted",
            "reset_reason": "learning winter again",
            "resets": 2,
        },
        "can": {
            "state": "ok",
            "channel": "can0",
            "frames": 1234567,
            "faults": {"lost": 3, "checksum": 1},
            "faults_last_minute": {"lost": 1},
            "age_s": 0.004,
            "detail": "",
        },
        "gnss": {
            "state": "down",
            "device": "/dev/ttyACM0",
            "fixes": 3600,
            "faults": {"unplugged": 1},
            "faults_last_minute": {},
            "age_s": 12.34,
            "detail": "no such device",
        },
        "resonance": None,
        "alarms": [
            {
                "time": 1000.0,
                "kind": "deflation",
                "wheel": "rl",
                "state": "raised",
                "deviation_mm": -3.2,
                "std_mm": 0.1,
                "probability": 0.997,
                "pressure_loss_percent": 31.0,
                "pressure_loss_std_percent": None,
                "reason": "lost 3.2 mm against the others",
            }
        ],
        "estimator": {
            "method": "mpf-pn",
            "informative": True,
            "informative_s": 312.5,
            "speed_mps": 24.5,
            "position_std_m": 0.8,
            "gnss_age_s": None,
            "effective_particles": 31.5,
            "ancestors": 17.0,
            "between_std_mm": 0.25,
            "change_probability": 0.125,
            "stated": {
                "fl": {"deviation_mm": None, "std_mm": None},
                "fr": {"deviation_mm": None, "std_mm": None},
                "rl": {"deviation_mm": 1.0, "std_mm": 0.1},
                "rr": {"deviation_mm": -2.0, "std_mm": 0.2},
            },
        },
    } == {key: value for key, value in DOCUMENT.items() if key not in ("watch", "wheels")}
    assert ["fl", "fr", "rl", "rr"] == list(DOCUMENT["wheels"])
    assert {
        "state": "learning",
        "deviation_mm": -1.0,
        "std_mm": 0.4,
        "change_mm": None,
        "change_std_mm": None,
        "deflation_probability": None,
        "deviation_probability": None,
        "pressure_loss_percent": None,
        "pressure_loss_std_percent": None,
        "last_change_mm": -0.2,
        "last_change_std_mm": 0.3,
        "last_change_age_s": 70.0,
    } == DOCUMENT["wheels"]["rr"]
    assert DOCUMENT == json.loads(json.dumps(DOCUMENT, allow_nan=False))


def test_before_the_first_tick_there_is_a_document_too() -> None:
    """Without report and estimate the document has its fields, empty."""
    waiting = SourceHealth(SourceState.WAITING)
    document = build_status(None, loop=LoopHealth(0.0, 0, 0), can=waiting, gnss=waiting)
    assert (None, {}, [], None) == tuple(document[key] for key in ("time", "wheels", "alarms", "estimator"))
    assert DOCUMENT.keys() == document.keys()
    assert "No wheel has been heard of yet." in render_status(document)


def test_the_table_says_it_in_words() -> None:
    """Wheels, alarms and sources as a driver reads them."""
    assert (
        f"tpmsd {__version__}, up for 1 h 02 min\n"
        "\n"
        "wheel         tyre              change in mm   from nominal\n"
        "front left    OK               +0.02 +- 0.11  +1.20 +- 0.13\n"
        "front right   soft?            -0.90 +- 0.11  +0.40 +- 0.13\n"
        "rear left     SOFT             -3.10 +- 0.10  -3.20 +- 0.10\n"
        "rear right    learning 40 %    -0.20 +- 0.30  -1.00 +- 0.40  (1 min ago)\n"
        "\n"
        "ALARM (for 3 min): Rear left tyre is losing air (lost 3.2 mm against the others)\n"
        "\n"
        "bus       can0 OK, 1234567 frames; faults in the last minute: lost 1; in all: checksum 1, lost 3\n"
        "receiver  /dev/ttyACM0 cannot be reached, 3600 fixes, the last 12.3 s ago (no such device);"
        " faults in the last minute: none; in all: unplugged 1\n"
        "loop      37250 ticks, 2 late\n"
    ) == render_status(DOCUMENT)


@pytest.mark.parametrize(
    ("state", "kind", "word"),
    [
        (WheelState.ALARM, AlarmKind.RADIUS_DEVIATION, "CHANGED"),
        (WheelState.UNAVAILABLE, AlarmKind.MALFUNCTION, "not watched"),
        (WheelState.UNAVAILABLE, None, "not watched"),
        (WheelState.ALARM, None, "ALARM"),
    ],
)
def test_each_state_has_its_word(state: WheelState, kind: AlarmKind | None, word: str) -> None:
    """The word for a tyre follows from the alarms that stand for it and from its state."""
    active = () if kind is None else (dataclasses.replace(DEFLATION, kind=kind, wheel="fl"),)
    wheels = (REPORT.wheels[0]._replace(state=state),)
    report = REPORT._replace(wheels=wheels, active=active)
    line = render_status(build_status(report, loop=LOOP, can=CAN, gnss=GNSS)).splitlines()[3]
    assert ["front left", word] == [line[:13].strip(), line[14:29].strip()]


def test_without_alarms_the_table_says_so() -> None:
    """'No alarms.' stands where alarms would."""
    quiet = build_status(REPORT._replace(active=()), loop=LOOP, can=CAN, gnss=GNSS)
    assert "No alarms." == render_status(quiet).splitlines()[8]


class Terminal(io.StringIO):
    """Somewhere to write that is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("out", "environment", "wanted"),
    [
        (Terminal(), {"TERM": "xterm"}, True),
        (Terminal(), {"TERM": "xterm", "NO_COLOR": "1"}, False),
        (Terminal(), {"TERM": "xterm", "NO_COLOR": ""}, True),
        (Terminal(), {"TERM": "dumb"}, False),
        (io.StringIO(), {"TERM": "xterm"}, False),
    ],
)
def test_colours_are_for_terminals_that_want_them(
    out: io.StringIO, environment: dict[str, str], wanted: bool
) -> None:
    """NO_COLOR, a dumb terminal or a pipe switch the colours off; an empty NO_COLOR does not count."""
    assert wanted == colour_wanted(out, environment)
    show(DOCUMENT, out, environment)
    assert wanted == ("\x1b[" in out.getvalue())


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("width", [60, 71, 80])
def test_no_line_is_wider_than_the_terminal(width: int, colour: bool) -> None:
    """Long lines go on in the next one with every word they had; the table itself fits from 60 columns on."""
    text = render_status(DOCUMENT, colour=colour, width=width)
    plain = re.sub(r"\x1b\[[0-9;]*m", "", text)

    assert [] == [line for line in plain.splitlines() if len(line) > width]
    assert render_status(DOCUMENT).split() == plain.split()
    if width >= 60:
        assert any(line.startswith("rear right    learning 40 %    -0.20") for line in plain.splitlines())
    words = {word for line in render_status(DOCUMENT).splitlines() for word in line.split()}
    assert [] == [word for line in plain.splitlines() for word in line.split() if word not in words], (
        "no word is broken"
    )


def test_a_narrow_terminal_has_no_line_that_is_too_wide() -> None:
    """At 40 columns the table leaves out the deviation from nominal, and no word is broken."""
    lines = render_status(DOCUMENT, width=40).splitlines()
    assert [] == [line for line in lines if len(line) > 40]
    assert "rear left   SOFT          -3.10 +- 0.10" in lines
    assert "    (1 min ago)" in lines
    whole = set(render_status(DOCUMENT).split())
    assert {word for line in lines for word in line.split()} <= whole


def test_colours_change_nothing_but_the_colour() -> None:
    """Without the escape codes the coloured table is the plain one, columns included."""
    coloured = render_status(DOCUMENT, colour=True)
    for code in ("\x1b[1m", "\x1b[2m", "\x1b[32m", "\x1b[33m", "\x1b[31;1m", "\x1b[0m"):
        assert code in coloured
        coloured = coloured.replace(code, "")
    assert render_status(DOCUMENT) == coloured


def test_watching_redraws_in_place_on_a_terminal() -> None:
    """A screen of its own; each update starts at the top and wipes the rest; the old one comes back."""
    out = Terminal()
    watch([DOCUMENT, DOCUMENT], out, {"NO_COLOR": "1"})
    first, *updates = out.getvalue().split("\x1b[H")
    assert "\x1b[?1049h\x1b[?25l" == first
    assert updates[-1].endswith("\x1b[J\x1b[?25h\x1b[?1049l")
    assert 2 == len(updates)
    for update in updates:
        assert "rear right" in update
        assert 24 >= update.count("\n") + 1


def test_watching_on_a_dumb_terminal_moves_no_cursor() -> None:
    """A terminal that knows no control sequences gets one table below the other."""
    out = Terminal()
    watch([DOCUMENT, DOCUMENT], out, {"TERM": "dumb"})
    assert "\x1b" not in out.getvalue()
    assert 2 == out.getvalue().count("rear right")


def test_watching_into_a_pipe_writes_one_table_below_the_other() -> None:
    """No escape codes where there is no terminal."""
    out = io.StringIO()
    watch([DOCUMENT, DOCUMENT], out, {"TERM": "xterm"})
    assert render_status(DOCUMENT) + "\n" + render_status(DOCUMENT) == out.getvalue()


def test_reasons_have_the_sign_of_the_table() -> None:
    """Text has `+-` in reasons and rows alike; pages have `±`."""
    alarm = {**DOCUMENT["alarms"][0], "reason": "changed by -5.8 +- 0.3 mm"}
    shown = render_status({**DOCUMENT, "alarms": [alarm]})
    assert "changed by -5.8 +- 0.3 mm" in shown
    assert "±" not in shown


def test_a_terminal_without_the_sign_gets_another() -> None:
    """All of it is ASCII, so that a terminal of any encoding shows it."""
    raw = io.BytesIO()
    out = io.TextIOWrapper(raw, encoding="ascii", write_through=True)
    show(DOCUMENT, out, {})
    assert b"+0.02 +- 0.11" in raw.getvalue()


def test_a_strangers_text_cannot_steer_the_terminal() -> None:
    """Control characters in any text of the document are not passed on."""
    evil = json.loads(json.dumps(DOCUMENT))
    bell = "\x1b]0;owned\x07\r\n"
    evil["tpmsd"] = evil["can"]["detail"] = evil["can"]["channel"] = evil["gnss"]["state"] = bell
    evil["alarms"][0] |= {"reason": bell, "kind": bell, "wheel": bell}
    evil["wheels"][bell] = {"state": bell}
    evil["can"]["faults"][bell] = 3
    assert not set(render_status(evil)) & {"\x1b", "\x07", "\r"}


json_values: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=150)
def test_a_document_of_the_wrong_shape_still_gives_a_table(data: st.DataObject) -> None:
    """Any value anywhere, whatever its type, leaves a table with its sections."""
    document = json.loads(json.dumps(DOCUMENT))
    place: Any = document
    while isinstance(place, dict | list) and place:
        key = data.draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
        inner = place[key]
        if not isinstance(inner, dict | list) or not inner or data.draw(st.booleans()):
            place[key] = data.draw(json_values)
            break
        place = inner
    text = render_status(document)
    assert "tpmsd" == text[:5]
    assert ["bus", "receiver", "loop"] == [line.split()[0] for line in text.splitlines()[-3:]]


def test_resonances_are_shown_where_they_are_listened_to() -> None:
    """Frequency now and when learned, the odds that the tyre is soft, or why nothing is known."""
    off = ResonanceStatus(ResonanceState.OFF, "sampled at 10 Hz")
    on = ResonanceStatus(ResonanceState.MONITORING, "", 36.5, 0.4, 37.5, math.log(3.0))
    document = build_status(REPORT, loop=LOOP, can=CAN, gnss=GNSS, resonance=(off, off, on, off))
    lines = render_status(json.loads(json.dumps(document))).splitlines()

    assert ["fl", "fr", "rl", "rr"] == list(document["resonance"])
    assert document["resonance"]["fl"] == {
        "state": "off",
        "reason": "sampled at 10 Hz",
        "frequency_hz": None,
        "std_hz": None,
        "baseline_hz": None,
        "log_ratio_soft": 0.0,
    }
    shown = [" ".join(line.split()) for line in lines if "Hz" in line or "to 1" in line]
    assert "rear left monitoring 36.50 +- 0.40 37.50 3 to 1" in shown
    assert "front left off - - (sampled at 10 Hz)" in shown
    assert {} == build_status(None, loop=LOOP, can=CAN, gnss=GNSS, resonance=(off,) * 4)["resonance"]


@pytest.mark.parametrize("strange", [None, 3, [], {"fl": 7}, {"fl": {"frequency_hz": "x", "state": 4}}])
def test_strange_resonances_do_not_stop_the_table(strange: object) -> None:
    """The document comes from another process."""
    assert "No alarms" in render_status({**DOCUMENT, "alarms": [], "resonance": strange})
