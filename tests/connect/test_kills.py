"""Daemon and bridges killed at random: the others go on, and no alarm is lost or doubled.

TPMSD_KILLS says how often each of them dies (twice in CI).
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import paho.mqtt.client as paho
from jeepney import HeaderFields, MatchRule, message_bus
from jeepney.io.blocking import DBusConnection
from jeepney.wrappers import unwrap_msg
from paho.mqtt.enums import CallbackAPIVersion

from tests.connect.servers import PATIENCE_S, Process, Server, free_port, program, wait_for
from tests.connect.test_dbus import bus, listener
from tests.interfaces.bridges.databroker import Databroker, databroker
from tests.interfaces.bridges.documents import alarm, document, served
from tests.onboard.daemon.fakes import car
from tpmsd.interfaces.bridges.dbus import NAME
from tpmsd.interfaces.bridges.vss_names import IS_PRESSURE_LOW
from tpmsd.onboard.daemon.state_keeper import StateKeeper
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sinks.status_client import StatusError, read_status

KILLS = int(os.environ.get("TPMSD_KILLS", "2"))
LOG = logging.getLogger("tests.connect")
RAISED_S = 1_700_000_000.0
ALARM = {
    "kind": "deflation",
    "wheel": "rl",
    "time_s": RAISED_S,
    "probability": 1.0,
    "reason": "soft",
    "pressure_loss": None,
    "pressure_loss_std": None,
    "since": "",
}


def car_with_an_alarm(folder: Path) -> Path:
    """A learned car whose state holds an alarm; its socket."""
    config, database = car(folder)
    snapshot = Pipeline(config, database).snapshot()
    snapshot["monitor"]["sets"]["baseline"] |= {"ready": True, "learned_s": 700.5}
    snapshot["monitor"]["alarms"] = [ALARM]
    StateKeeper(config, LOG).save(0.0, snapshot)
    return config.status.socket


class Ear:
    """What a listener on D-Bus believes, by the rules of docs/how-to/notify.md."""

    def __init__(self, connection: DBusConnection) -> None:
        self._connection = connection
        rule = MatchRule(type="signal", member="NameOwnerChanged", sender="org.freedesktop.DBus")
        unwrap_msg(connection.send_and_get_reply(message_bus.AddMatch(rule), timeout=5.0))
        self.standing: set[tuple[Any, ...]] = set()
        """Kind, wheel and time of each alarm; those of inputs are left out, for the car has none."""
        self.ever: set[tuple[Any, ...]] = set()
        self.doubled: list[tuple[Any, ...]] = []
        self.owners = 0

    def listen(self) -> set[tuple[Any, ...]]:
        """The alarms that stand, after all that was said until now."""
        with contextlib.suppress(TimeoutError):
            while True:
                message = self._connection.receive(timeout=0.01)
                member, body = message.header.fields.get(HeaderFields.member), tuple(message.body)
                if member == "NameOwnerChanged" and body[0] == NAME and body[2]:
                    self.standing.clear()
                    self.owners += 1
                elif body[0] == "malfunction":
                    continue
                elif member == "AlarmRaised":
                    self.doubled += [body[:3]] if body[:3] in self.standing else []
                    self.standing.add(body[:3])
                    self.ever.add(body[:3])
                elif member == "AlarmCleared":
                    self.standing.remove(body[:3])
        return self.standing


@contextlib.contextmanager
def subscribed(port: int) -> Iterator[tuple[dict[str, str], list[str]]]:
    """What a broker retains, by topic, and the events that it hands on."""
    retained: dict[str, str] = {}
    events: list[str] = []

    def received(_client: object, _data: object, message: paho.MQTTMessage) -> None:
        text = message.payload.decode()
        if message.topic.endswith("/event"):
            events.append(text)
        else:
            retained[message.topic] = text

    client = paho.Client(CallbackAPIVersion.VERSION2, client_id="ear", clean_session=False)
    client.on_connect = lambda client, *_: client.subscribe("#", qos=1)
    client.on_message = received
    client.connect("localhost", port)
    client.loop_start()
    try:
        yield retained, events
    finally:
        client.disconnect()
        client.loop_stop()


def mosquitto(folder: Path) -> Server:
    port = free_port()
    lines = [f"listener {port} 127.0.0.1", "allow_anonymous true"]
    lines += ["user root"] if os.geteuid() == 0 else []
    (folder / "mosquitto.conf").write_text("\n".join(lines) + "\n", "utf-8")
    command = [program("mosquitto"), "-c", str(folder / "mosquitto.conf")]
    return Server(command, folder / "mosquitto.log", port)


def metrics(port: int) -> str:
    with contextlib.suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        return str(answer.read().decode())
    return ""


def ticks(path: Path) -> int:
    """How many the daemon has made; 0 while it does not answer."""
    try:
        return int(read_status(path)["ticks"])
    except StatusError:
        return 0


def test_one_of_five_is_killed_again_and_again(tmp_path: Path) -> None:
    """Daemon and bridges die in random order; after each the same alarm is active everywhere."""
    rng = np.random.default_rng(23)
    path, port = car_with_an_alarm(tmp_path / "car"), free_port()
    owners, soft = 1, ("deflation", "rl", RAISED_S)
    broker, kuksa = mosquitto(tmp_path), Databroker()
    with contextlib.ExitStack() as stack:
        stack.enter_context(bus(tmp_path))
        ear = Ear(stack.enter_context(listener(tmp_path)))
        stack.enter_context(broker)
        retained, events = stack.enter_context(subscribed(broker.port))
        vss_port = stack.enter_context(databroker(kuksa))
        common = ("--socket", str(path))
        processes = {
            "daemon": Process(tmp_path, "run", "--config", str(tmp_path / "car")),
            "mqtt": Process(
                tmp_path, "bridge", "mqtt", "--broker", f"localhost:{broker.port}", "--period", "1", *common
            ),
            "prometheus": Process(tmp_path, "bridge", "prometheus", "--port", str(port), *common),
            "dbus": Process(tmp_path, "bridge", "dbus", "--bus", f"unix:path={tmp_path / 'bus'}", *common),
            "vss": Process(
                tmp_path, "bridge", "vss", "--databroker", f"localhost:{vss_port}", "--period", "1", *common
            ),
        }
        stack.callback(lambda: [one.end(signal.SIGKILL) for one in processes.values()])
        stands: dict[str, Callable[[], bool]] = {
            "daemon": lambda: ticks(path) > 0,
            "mqtt": lambda: f"deflation:rl:{RAISED_S:.3f}" in retained.get("tpmsd/car/state", ""),
            "prometheus": lambda: 'tpmsd_alarm_active{kind="deflation",wheel="rl"} 1.0' in metrics(port),
            "dbus": lambda: {soft} == ear.listen() and ear.owners == owners,
            "vss": lambda: kuksa.by_wheel()[2] is True,
        }
        for name, ask in stands.items():
            wait_for(f"the alarm at {name}", ask, PATIENCE_S)
        order = list(stands) * KILLS
        rng.shuffle(order)
        for victim in order:
            before = {name: one.pid for name, one in processes.items() if name != victim}
            made = ticks(path)
            processes[victim].end(signal.SIGKILL)
            owners += victim == "dbus"
            retained.clear()  # both are told again every second
            kuksa.values.clear()
            time.sleep(float(rng.uniform(0.0, 0.5)))
            processes[victim].start()
            for name, ask in stands.items():
                wait_for(f"the alarm at {name}, {victim} killed", ask, PATIENCE_S)
            assert before == {
                name: one.pid for name, one in processes.items() if name != victim and one.lives()
            }
            if victim != "daemon":
                assert made <= ticks(path)
        assert (1 + KILLS, [], {soft}) == (ear.owners, ear.doubled, ear.ever)
        announced = [one for one in events if "deflation:rl" in one]
        assert not [one for one in announced if '"cleared"' in one]
        # Who was killed between an event and the list that remembers it repeats the event, with the same key.
        assert 1 <= len(announced) <= 1 + KILLS // 5
        assert {IS_PRESSURE_LOW["rl"]} == {path for path, low in kuksa.written if low}
        print(f"{len(order)} kills, {len(announced)} announcements by MQTT, {ear.owners} owners on D-Bus")


def test_alarms_that_change_while_the_dbus_bridge_dies(tmp_path: Path) -> None:
    """Alarms come and go, and the bridge is killed in between: a listener ends up with those that stand."""
    rng = np.random.default_rng(24)
    with served(tmp_path / "s") as daemon, bus(tmp_path), listener(tmp_path) as connection:
        ear = Ear(connection)
        process = Process(
            tmp_path,
            "bridge",
            "dbus",
            "--bus",
            f"unix:path={tmp_path / 'bus'}",
            "--socket",
            str(tmp_path / "s"),
        )
        try:
            for number in range(KILLS):
                latest = [2000.0 + n for n in range(max(0, number - 2), number + 1)]
                daemon.document = document(*(alarm(time_s=time_s) for time_s in latest))
                time.sleep(float(rng.uniform(0.0, 0.6)))
                process.end(signal.SIGKILL)
                process.start()
                wanted = {("deflation", "rl", time_s) for time_s in latest}
                wait_for(f"the alarms after kill {number}", lambda w=wanted: ear.listen() == w, PATIENCE_S)  # type: ignore[misc]
            daemon.document = document()
            wait_for("the end of all", lambda: not ear.listen(), PATIENCE_S)
        finally:
            assert 0 == process.end(signal.SIGTERM)
    assert [] == ear.doubled
    assert {("deflation", "rl", 2000.0 + n) for n in range(KILLS)} == ear.ever


def test_values_of_a_databroker_that_was_killed_are_there_again(tmp_path: Path) -> None:
    """A databroker that is killed and forgets all has every value again, an alarm of the time between too."""
    port = free_port()
    with served(tmp_path / "s") as daemon:
        options = ("--databroker", f"localhost:{port}", "--socket", str(tmp_path / "s"), "--period", "1")
        process = Process(tmp_path, "bridge", "vss", *options)
        try:
            for wheel, low in (("fl", 0), ("rr", 3)):
                daemon.document = document(alarm(wheel=wheel))
                kuksa = Databroker()
                with databroker(kuksa, port):
                    wanted = [k == low for k in range(4)]
                    wait_for(f"{wheel}", lambda k=kuksa, w=wanted: k.by_wheel() == w, PATIENCE_S)  # type: ignore[misc]
        finally:
            assert 0 == process.end(signal.SIGTERM)
