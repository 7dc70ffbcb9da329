"""Debian's mosquitto with TLS and passwords, killed and restarted; the bridge as a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import paho.mqtt.client as paho
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from tests.connect.servers import Server, free_port, program, wait_for
from tests.interfaces.bridges.documents import alarm, document, served

USER, PASSWORD = "car", "not-a-secret"
KILLS = int(os.environ.get("TPMSD_KILLS", "15"))


def certificate(folder: Path) -> None:
    """An authority, and a certificate of it for localhost."""
    openssl = program("openssl")
    subject = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    for command in (
        "req -x509 -newkey rsa:2048 -nodes -keyout ca.key -out ca.pem -days 2 -subj /CN=authority",
        "req -newkey rsa:2048 -nodes -keyout key.pem -out csr.pem " + " ".join(subject),
        "x509 -req -in csr.pem -CA ca.pem -CAkey ca.key -CAcreateserial -out cert.pem -days 2"
        " -copy_extensions copy",
    ):
        subprocess.run([openssl, *command.split()], cwd=folder, check=True, capture_output=True)


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    mosquitto = program("mosquitto")
    folder = tmp_path_factory.mktemp("broker")
    certificate(folder)
    port = free_port()
    (folder / "passwords").touch(0o600)
    subprocess.run(
        [program("mosquitto_passwd"), "-b", str(folder / "passwords"), USER, PASSWORD],
        check=True,
        capture_output=True,
    )
    lines = [
        f"listener {port} 127.0.0.1",
        *(f"{key} {folder}/{name}" for key, name in (("certfile", "cert.pem"), ("keyfile", "key.pem"))),
        *("allow_anonymous false", f"password_file {folder}/passwords"),
        *("persistence true", f"persistence_location {folder}/", "max_queued_messages 1000"),
        *(["user root"] if os.geteuid() == 0 else []),
    ]
    (folder / "mosquitto.conf").write_text("\n".join(lines) + "\n", "utf-8")
    (folder / "password").write_text(PASSWORD, "utf-8")
    server = Server([mosquitto, "-c", str(folder / "mosquitto.conf")], folder / "mosquitto.log", port)
    with server:
        yield server


class Listener:
    """A client that remembers all that it hears; the broker keeps events for it while it is away."""

    def __init__(self, broker: Server, name: str) -> None:
        self.retained: dict[str, str] = {}
        self.events: list[tuple[str, str]] = []
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id=name, clean_session=False)
        self._client.username_pw_set(USER, PASSWORD)
        self._client.tls_set_context(ssl.create_default_context(cafile=str(broker.log.parent / "ca.pem")))
        self._client.reconnect_delay_set(1, 1)
        self.subscribed = threading.Event()
        self._client.on_connect = lambda client, *_: client.subscribe("#", qos=1)
        self._client.on_subscribe = lambda *_: self.subscribed.set()
        self._client.on_message = self._on_message
        self._client.connect_async("localhost", broker.port)
        self._client.loop_start()
        assert self.subscribed.wait(10.0)

    def _on_message(self, _client: object, _data: object, message: paho.MQTTMessage) -> None:
        text = message.payload.decode()
        if message.topic.endswith("/event"):
            event = json.loads(text)
            self.events.append((event["state"], event["key"]))
        else:
            self.retained[message.topic] = text

    def state(self) -> dict[str, object]:
        return dict(json.loads(self.retained.get("tpmsd/car/state", "{}")))

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


class Bridge:
    """The bridge's process."""

    def __init__(self, broker: Server, socket: Path, ca: str = "ca.pem") -> None:
        folder = broker.log.parent
        self.log = socket.parent / "bridge.log"
        options = ["--broker", f"localhost:{broker.port}", "--socket", str(socket), "--period", "0.5"]
        options += ["--ca", str(folder / ca), "--user", USER, "--password-file", str(folder / "password")]
        with self.log.open("ab") as log:
            command = [sys.executable, "-m", "tpmsd", "bridge", "mqtt", *options]
            self.process = subprocess.Popen(command, stdout=log, stderr=log)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(10.0)


@contextlib.contextmanager
def listening(broker: Server, name: str) -> Iterator[Listener]:
    listener = Listener(broker, name)
    try:
        yield listener
    finally:
        listener.close()


def test_state_is_right_after_the_broker_was_away(broker: Server, tmp_path: Path) -> None:
    """Over TLS: discovery, state and availability; a killed broker comes back to the state of the moment."""
    with served(tmp_path / "s") as daemon, listening(broker, "watcher") as listener:
        bridge = Bridge(broker, tmp_path / "s")
        wait_for("the state", lambda: listener.state().get("health") == "ok")
        wait_for("discovery", lambda: sum(topic.endswith("/config") for topic in listener.retained) == 14)
        assert "online" == listener.retained["tpmsd/car/availability"]
        # An alarm is raised, and another raised and cleared, while nobody is there.
        broker.stop(signal.SIGKILL)
        daemon.document = document(alarm(), alarm("slow_leak", "fr"))
        time.sleep(1.0)
        daemon.document = document(alarm())
        time.sleep(1.0)
        assert bridge.process.poll() is None
        listener.retained.clear()
        broker.start()
        wait_for("the state again", lambda: bool(listener.state().get("alarms")), 20.0)
        wheels = listener.state()["wheels"]
        assert isinstance(wheels, dict)
        assert ["rl"] == [name for name, wheel in wheels.items() if wheel["problem"]]
        with listening(broker, "latecomer") as late:  # what a killed broker had retained is there again
            wait_for("all that is retained", lambda: len(late.retained) == 17)
        # The daemon goes: that is said. The bridge is killed: the broker says so.
        daemon.document = document()
        wait_for("the end of the alarm", lambda: listener.state().get("alarms") == [])
        assert bridge.stop(signal.SIGKILL) != 0
        wait_for("the last will", lambda: listener.retained["tpmsd/car/availability"] == "offline", 40.0)
        again = Bridge(broker, tmp_path / "s")
        wait_for("the return", lambda: listener.retained["tpmsd/car/availability"] == "online")
        assert 0 == again.stop()
        wait_for("the orderly end", lambda: listener.retained["tpmsd/car/availability"] == "offline")


def test_a_broker_of_another_authority_is_not_trusted(broker: Server, tmp_path: Path) -> None:
    """To a broker without a certificate of the configured authority nothing is sent, no password either."""
    (tmp_path / "other").mkdir()
    certificate(tmp_path / "other")
    other = broker.log.parent / "other.pem"
    other.write_bytes((tmp_path / "other" / "ca.pem").read_bytes())
    with served(tmp_path / "s"):
        bridge = Bridge(broker, tmp_path / "s", ca="other.pem")
        wait_for("the refusal", lambda: "cannot be reached" in bridge.log.read_text("utf-8"))
        assert bridge.process.poll() is None
        bridge.stop()


def test_no_alarm_is_lost_or_doubled_when_bridge_and_broker_die(broker: Server, tmp_path: Path) -> None:
    """Killed at random, the bridge announces every alarm that lasts; doubles bear the key of the first."""
    rng = np.random.default_rng(4)
    with served(tmp_path / "s") as daemon, listening(broker, "recorder") as listener:
        bridge = Bridge(broker, tmp_path / "s")
        wait_for("the state", lambda: listener.state().get("health") == "ok")
        wait_for("no alarms", lambda: listener.retained.get("tpmsd/car/alarms") == "[]")
        listener.events.clear()
        raised: list[float] = []
        for number in range(KILLS):
            raised.append(2000.0 + number)
            daemon.document = document(*(alarm(time_s=time_s) for time_s in raised[-3:]))
            time.sleep(float(rng.uniform(0.1, 1.2)))
            bridge.stop(signal.SIGKILL)
            if number == KILLS // 2:  # in between the broker, which keeps what it has accepted
                broker.stop()
                broker.start()
            bridge = Bridge(broker, tmp_path / "s")
            # An alarm that lasts: until a bridge has had time to see it.
            newest = f"deflation:rl:{raised[-2 if number % 3 else -1] if number else raised[-1]:.3f}"
            wait_for("the announcement", lambda key=newest: ("raised", key) in listener.events)  # type: ignore[misc]
        daemon.document = document()
        expected = [f"deflation:rl:{time_s:.3f}" for time_s in raised]
        wait_for(
            "all to be cleared", lambda: {k for s, k in listener.events if s == "cleared"} >= set(expected)
        )
        assert daemon.document["ticks"] == 600  # the daemon's side went on all the while
        bridge.stop()
    for key in expected:
        states = [state for state, one in listener.events if one == key]
        assert ["raised", "cleared"] == [s for k, s in enumerate(states) if k == 0 or states[k - 1] != s]
    doubles = len(listener.events) - 2 * len(expected)
    print(f"{KILLS} kills, {len(expected)} alarms, {doubles} events twice with the same key")
    assert 0 <= doubles <= max(3, KILLS // 5), f"{doubles} events came twice"
