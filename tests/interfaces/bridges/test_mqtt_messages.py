"""Which messages follow from which documents, whatever dies when."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.interfaces.bridges.documents import alarm, document
from tpmsd.interfaces.bridges.home_assistant import discovery
from tpmsd.interfaces.bridges.mqtt_messages import MAX_EVENTS, Announcer, Topics, alarms_of_payload
from tpmsd.interfaces.bridges.summary import DaemonSummary, summarise

TOPICS = Topics("tpmsd/car")


def ready(retained: bytes | None = None) -> Announcer:
    announcer = Announcer(TOPICS, 10.0)
    announcer.recall(retained)
    return announcer


def said(announcer: Announcer) -> list[tuple[str, str]]:
    events = [json.loads(event.payload) for event in announcer.events]
    announcer.events.clear()
    return [(event["state"], event["key"]) for event in events]


def test_an_alarm_is_announced_once_raised_and_once_cleared() -> None:
    """However often the document says it, the events are two."""
    announcer = ready()
    for alarms in ([], [alarm()], [alarm()], [], []):
        announcer.update(summarise(document(*alarms)))

    assert [("raised", "deflation:rl:1000.000"), ("cleared", "deflation:rl:1000.000")] == said(announcer)


def test_state_is_reported_when_it_changes_and_now_and_then() -> None:
    """Numbers wait for the period, a change of state or an alarm does not; all of it is retained."""
    announcer = ready()
    calm, soft = summarise(document()), summarise(document(alarm()))
    topics = [
        [message.topic.removeprefix("tpmsd/car/") for message in announcer.state(summary, now_s, again)]
        for summary, now_s, again in (
            (calm, 0.0, False), (calm, 9.9, False), (calm, 10.0, False), (soft, 11.0, False), (soft, 12, True)
        )
    ]  # fmt: skip

    assert [["state", "alarms"], [], ["state"], ["state", "alarms"], ["state", "alarms"]] == topics
    assert all(message.retain for message in announcer.state(calm, 30.0, True))


def test_a_daemon_that_has_just_started_clears_nothing() -> None:
    """Before its first tick a daemon does not know its alarms; that is no clearance."""
    announcer = ready()
    announcer.update(summarise(document(alarm())))
    announcer.update(summarise(document(time=None)))
    announcer.update(summarise(document(alarm())))

    assert [("raised", "deflation:rl:1000.000")] == said(announcer)


def test_what_happened_before_the_broker_was_reached_is_not_lost() -> None:
    """An alarm that came and went while nobody knew what had been announced is announced after all."""
    announcer = Announcer(TOPICS, 10.0)
    for alarms in ([alarm("slow_leak")], [alarm("slow_leak"), alarm()], [alarm("slow_leak")]):
        announcer.update(summarise(document(*alarms)))
    assert [] == said(announcer)
    announcer.recall(announcer.state(summarise(document(alarm("slow_leak"))), 0.0)[1].payload.encode())

    assert [("raised", "deflation:rl:1000.000"), ("cleared", "deflation:rl:1000.000")] == said(announcer)


def test_an_hour_without_broker_takes_bounded_memory() -> None:
    """The newest events are kept, the others counted."""
    announcer = ready()
    for k in range(3600):
        announcer.update(summarise(document(*([alarm(time_s=float(k))] if k % 2 else []))))

    assert (MAX_EVENTS, 3599 - MAX_EVENTS) == (len(announcer.events), announcer.dropped)
    assert "cleared" == said(announcer)[-2][0]


steps = st.lists(
    st.one_of(
        st.sets(st.sampled_from(["fl", "fr", "rl"])).map(sorted),
        st.sampled_from(["bridge killed", "killed after events", "broker away", "broker back"]),
    ),
    max_size=30,
)


@settings(derandomize=True, deadline=None, max_examples=300)
@given(steps)
def test_no_alarm_is_lost_or_doubled_whatever_dies_when(course: list[list[str] | str]) -> None:
    """Seen from the broker: every alarm that still stands was raised; raised and cleared alternate per alarm.

    A repetition of the very last event of an alarm is allowed where the bridge was killed between event and
    retained alarms, and nowhere else.
    """
    retained: bytes | None = None
    log: list[tuple[str, str]] = []
    online, may_repeat = True, False
    announcer = ready(retained)
    current: DaemonSummary = summarise(document())
    raised_at: dict[str, float] = {}
    clock_s = 0.0

    def deliver(with_alarms: bool) -> None:
        nonlocal retained
        if not online:
            return
        log.extend(said(announcer))
        if with_alarms:
            for message in announcer.state(current, clock_s, True):
                if message.topic == TOPICS.alarms:
                    retained = message.payload.encode()

    for step in [*course, "broker back"]:
        clock_s += 1.0
        if isinstance(step, list):
            raised_at = {wheel: raised_at.get(wheel, clock_s) for wheel in step}
            current = summarise(document(*(alarm(wheel=w, time_s=t) for w, t in sorted(raised_at.items()))))
            announcer.update(current)
            deliver(True)
        elif step == "broker away":
            online = False
        elif step == "broker back":
            online = True
            deliver(True)
        elif online:
            if step == "killed after events":
                announcer.update(current)
                deliver(False)
                may_repeat = True
            announcer = ready(retained)
            announcer.update(current)
            deliver(True)
    assert {a.key for a in current.alarms} == raised_by(log, may_repeat)


def raised_by(log: list[tuple[str, str]], may_repeat: bool) -> set[str]:
    """The alarms that stand after (state, alarm) as sent, each of which was raised and cleared in turn."""
    by_key: dict[str, list[str]] = {}
    for state, key in log:
        by_key.setdefault(key, []).append(state)
    for states in by_key.values():
        once = [s for k, s in enumerate(states) if k == 0 or states[k - 1] != s]
        assert may_repeat or once == states
        assert once == ["raised", "cleared"][: len(once)]
    return {key for key, states in by_key.items() if states[-1] == "raised"}


@settings(derandomize=True, deadline=None, max_examples=300)
@given(st.one_of(st.binary(max_size=300), st.text(max_size=100).map(str.encode)))
def test_anything_retained_is_borne(payload: bytes) -> None:
    """A stranger's message on our topic raises nothing."""
    announcer = ready(payload)
    announcer.update(summarise(document(alarm())))

    assert [("raised", "deflation:rl:1000.000")] == [
        event for event in said(announcer) if event[0] == "raised"
    ]


@pytest.mark.parametrize(
    "payload",
    [
        b"[" * 100_000,
        b'[{"kind": 1}, {"kind": "deflation", "time": true}, {"kind": "deflation", "time": 1e400}, 3]',
        b'[{"kind": "deflation", "wheel": 3, "time": 1}]',
        b'[{"kind": "deflation", "wheel": "fl", "time": NaN}, {"kind": "deflation", "time": -Infinity}]',
        b'[{"kind": "deflation", "time": 1' + 400 * b"0" + b"}]",
        b'[{"kind": "x\\u001b[2J", "time": 1}, {"kind": "a/#", "time": 1}, {"kind": "' + 51 * b"a" + b'"}]',
        b'[{"kind": "deflation", "wheel": "fl\\u0000", "time": 1}, {"kind": "deflation", "wheel": "+"}]',
        b'[{"kind": "deflation", "wheel": ["fl"], "time": 1}, {"kind": "\\ud800", "time": 1}]',
        b" " * 70_000 + b"[]",
    ],
)
def test_nonsense_that_is_retained_counts_for_nothing(payload: bytes) -> None:
    """Deep, huge and mistyped messages give no alarms."""
    assert [] == list(alarms_of_payload(payload))


def test_a_retained_message_puts_no_text_of_its_own_into_ours() -> None:
    """Alarms of an earlier run are cleared by kind, wheel and time alone; what else stands there, control
    characters and numbers that are none, neither ends the bridge nor goes out again."""
    retained = b"""[{"kind": "deflation", "wheel": "fl", "time": 5, "reason": "\\u001b]0;x", "key": "#"},
        {"kind": "deflation", "wheel": "fr", "time": NaN}, {"kind": "\\u0000", "wheel": null, "time": 5}]"""
    announcer = ready(retained)
    announcer.update(summarise(document()))
    (event,) = announcer.events
    assert "\\u" not in event.payload
    assert event.payload.isprintable()
    assert [("cleared", "deflation:fl:5.000")] == said(announcer)


def test_home_assistant_gets_four_problems_and_their_numbers() -> None:
    """One device; per wheel a binary sensor of class problem and two numbers, and the health of the whole."""
    messages = discovery("homeassistant", "car", "tpmsd/car", "9.9", ("fl", "fr", "rl", "rr"))
    configs = [config for _, config in messages]

    assert 14 == len(messages) == len({config["unique_id"] for config in configs})
    assert 1 == len({json.dumps(config["device"]) for config in configs})
    assert 5 == sum(config.get("device_class") == "problem" for config in configs)
    assert "homeassistant/binary_sensor/tpmsd_car/fl_problem/config" == messages[0][0]
    assert {"tpmsd/car/state"} == {config["state_topic"] for config in configs}
    assert {"tpmsd/car/availability"} == {config["availability_topic"] for config in configs}


def test_templates_find_what_the_state_holds() -> None:
    """Every template of a discovery message, filled in from a published state, gives the document's value."""
    jinja2 = pytest.importorskip("jinja2")
    state = ready().state(summarise(document(alarm())), 0.0)[0].payload
    filled = {
        config["unique_id"].removeprefix("tpmsd_car_"): jinja2.Template(config["value_template"]).render(
            value_json=json.loads(state)
        )
        for _, config in discovery("homeassistant", "car", "tpmsd/car", "9.9", ("rl", "rr"))
    }

    assert {
        "rl_problem": "ON", "rl_deviation": "-0.5", "rl_pressure_loss": "4.0",
        "rr_problem": "OFF", "rr_deviation": "-0.5", "rr_pressure_loss": "4.0",
        "malfunction": "OFF", "health": "ok",
    } == filled  # fmt: skip
