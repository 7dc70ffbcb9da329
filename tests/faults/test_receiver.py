"""Faults of the receiver: what was wrong is counted and said, and alarms are neither lost nor false."""

from __future__ import annotations

import dataclasses
import datetime
import functools
import operator
from collections.abc import Callable

import numpy as np
import pytest

from tests.faults.drives import FOUND, FROM_S, TO_S, Change, Item, Outcome, during, played
from tpmsd.car.config.model import Config
from tpmsd.onboard.sources.drive import Sentence
from tpmsd.onboard.sources.events import SourceFault

pytestmark = pytest.mark.usefixtures("method")

Rewrite = Callable[[list[bytes]], list[bytes] | None]
"""From the fields of a sentence to others; None leaves it out."""


def sentence(fields: list[bytes]) -> bytes:
    body = b",".join(fields)
    return b"$%s*%02X" % (body, functools.reduce(operator.xor, body))


def sentences(rewrite: Rewrite, from_s: float = FROM_S, to_s: float = TO_S) -> Change:
    """Rewrite the sentences of a part of the drive."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        out: list[Item] = []
        for item in items:
            if isinstance(item, Sentence) and during(item.time_s, start_s, from_s, to_s):
                fields = rewrite(item.line[1 : item.line.rindex(b"*")].split(b","))
                if fields is not None:
                    out.append(item._replace(line=sentence(fields)))
            else:
                out.append(item)
        return out

    return change


def place_at(fields: list[bytes]) -> int:
    """Index of the latitude."""
    return 3 if fields[0].endswith(b"RMC") else 2


def impatient(config: Config) -> Config:
    """Malfunctions after 8 s, of the receiver's fixes too."""
    monitor = dataclasses.replace(config.monitor, malfunction_s=8.0, gnss_malfunction_s=8.0)
    return dataclasses.replace(config, monitor=monitor)


def tyre_alarms(outcome: Outcome) -> list[tuple[str, str | None, str]]:
    return [alarm for alarm in outcome.alarms if alarm[0] != "malfunction"]


def malfunctions(outcome: Outcome) -> list[str]:
    return [state for kind, _, state in outcome.alarms if kind == "malfunction"]


def test_an_unplugged_receiver_is_a_malfunction_that_ends() -> None:
    """Gone for 25 s: said after 8 s though no fix is missed for long yet, taken back, and the loss found."""
    outcome = played(
        sentences(lambda fields: None),
        config=lambda config: dataclasses.replace(
            impatient(config), monitor=dataclasses.replace(config.monitor, malfunction_s=8.0)
        ),
        events=lambda time_s: (
            [SourceFault(0.0, "gnss", "unplugged", "gone")] if FROM_S <= time_s < TO_S else []
        ),
    )

    assert ["raised", "cleared"] == malfunctions(outcome)
    assert "the receiver is unplugged or cannot be opened" == outcome.reasons[0]
    assert FROM_S + 7.5 < outcome.when("malfunction") < FROM_S + 10.0
    assert FOUND == tyre_alarms(outcome)


def test_a_silent_receiver_is_a_malfunction_that_ends() -> None:
    """No fix for long while driving: said, taken back with the fixes; the wheels are compared on."""
    outcome = played(sentences(lambda fields: None), config=impatient)

    assert ["raised", "cleared"] == malfunctions(outcome)
    assert "no usable fix from the receiver while driving" == outcome.reasons[0]
    assert FOUND == tyre_alarms(outcome)


def test_garbage_from_the_receiver_is_counted() -> None:
    """Lines of random bytes: each is counted, and the loss is found."""
    rng = np.random.default_rng(8)

    def garbage(items: list[Item], start_s: float) -> list[Item]:
        return [
            item._replace(line=rng.integers(0, 256, 40, dtype=np.uint8).tobytes())
            if isinstance(item, Sentence) and during(item.time_s, start_s)
            else item
            for item in items
        ]

    outcome = played(garbage)

    assert FOUND == outcome.alarms
    assert 250 == outcome.counts["gnss.garbage"]


@pytest.mark.parametrize("standing", [False, True])
def test_a_frozen_position_is_not_believed(standing: bool) -> None:
    """The same position for 25 s, with the speed going on or saying 0: counted or said, no tyre accused."""
    held: list[list[bytes]] = []

    def freeze(fields: list[bytes]) -> list[bytes]:
        place = place_at(fields)
        held.append(fields[place : place + 4])
        fields[place : place + 4] = held[0]
        if standing and fields[0].endswith(b"RMC"):
            fields[7], fields[8] = b"0.000", b""
        return fields

    outcome = played(sentences(freeze), config=impatient)

    assert FOUND == tyre_alarms(outcome)
    assert {"raised", "cleared"} == set(malfunctions(outcome))
    assert malfunctions(outcome).count("raised") == malfunctions(outcome).count("cleared")
    if standing:
        assert outcome.reasons[0].startswith("wheels and receiver disagree on the speed")
    else:
        assert 1 == outcome.faults[("gnss", "frozen")]
        assert outcome.counts["gnss.frozen"] > 100


def test_a_receiver_that_repeats_itself_is_reported() -> None:
    """The same epoch over and over: counted as repeated, used once, and missed as any other fix."""
    held: dict[bytes, list[bytes]] = {}
    outcome = played(sentences(lambda fields: held.setdefault(fields[0], fields)), config=impatient)

    assert FOUND == tyre_alarms(outcome)
    assert ["raised", "cleared"] == malfunctions(outcome)
    assert 124 == outcome.counts["gnss.repeated"]


@pytest.mark.parametrize("to_s", [FROM_S + 0.5, TO_S])
def test_a_jump_of_ten_kilometres_moves_no_radius(to_s: float) -> None:
    """Away and back again, at once or for 25 s: reported, and the radii stay those of the car."""

    def jump(fields: list[bytes]) -> list[bytes]:
        place = place_at(fields)
        fields[place] = b"%.6f" % (float(fields[place]) + 60 * 0.09)
        return fields

    outcome = played(sentences(jump, to_s=to_s))

    assert FOUND == outcome.alarms
    assert 2 == outcome.faults[("gnss", "leap")]
    deviations = [
        step.estimate.deviation_m
        for step in outcome.steps
        if FROM_S < step.tick.time_s - outcome.start_s < 104.0
    ]
    assert float(np.ptp(np.array(deviations), axis=0).max()) < 4e-4


def test_a_week_number_that_rolls_over_is_put_right() -> None:
    """From one epoch on the date is 1024 weeks ago: corrected, reported once, and no fix is lost."""

    def long_ago(fields: list[bytes]) -> list[bytes]:
        if fields[0].endswith(b"RMC"):
            date = datetime.datetime.strptime(fields[9].decode(), "%d%m%y")
            fields[9] = (date - datetime.timedelta(weeks=1024)).strftime("%d%m%y").encode()
        return fields

    outcome = played(sentences(long_ago, to_s=1e9))

    assert FOUND == outcome.alarms
    assert 1 == outcome.faults[("gnss", "week_rollover")]
    assert 751 == outcome.counts["gnss.fixes"]


def test_a_leap_second_costs_no_fix_its_place() -> None:
    """At 75 s the receiver counts 23:59:60; the time after is a second behind, and taken up at once."""
    leap_s = datetime.datetime(2016, 12, 31, 23, 59, 60 - 1, tzinfo=datetime.UTC).timestamp() + 1.0
    at_s: list[float] = []

    def with_leap(items: list[Item], start_s: float) -> list[Item]:
        # At the drive's 75th second (UTC of the receiver) the leap second begins.
        out: list[Item] = []
        for item in items:
            if not isinstance(item, Sentence):
                out.append(item)
                continue
            fields = item.line[1 : item.line.rindex(b"*")].split(b",")
            hour, minute, second = int(fields[1][:2]), int(fields[1][2:4]), float(fields[1][4:])
            of_day_s = 3600.0 * hour + 60.0 * minute + second
            at_s.append(of_day_s)
            since_s = of_day_s - at_s[0] - 75.0
            if 0.0 <= since_s < 1.0:
                day, text = leap_s - 1.0, f"2359{60 + since_s:06.3f}"
            else:
                utc_s = leap_s + since_s - (1.0 if since_s >= 1.0 else 0.0)
                day = utc_s
                moment = datetime.datetime.fromtimestamp(round(utc_s, 3), datetime.UTC)
                text = moment.strftime("%H%M%S.") + f"{moment.microsecond // 1000:03d}"
            fields[1] = text.encode()
            if fields[0].endswith(b"RMC"):
                fields[9] = datetime.datetime.fromtimestamp(day, datetime.UTC).strftime("%d%m%y").encode()
            out.append(item._replace(line=sentence(fields)))
        return out

    outcome = played(with_leap)

    assert FOUND == outcome.alarms
    assert 751 == outcome.counts["gnss.fixes"]
    assert outcome.faults[("gnss", "late")] <= 5
    placed = sum(len(s.tick.fixes) for s in outcome.steps if s.tick.time_s - outcome.start_s > FROM_S)
    assert placed > 5 * (150.0 - FROM_S - 3.0)
