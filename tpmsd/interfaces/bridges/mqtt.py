"""`tpmsd bridge mqtt`: the daemon's state and alarms to an MQTT broker.

In: the status socket, a broker. Out: messages (`mqtt_messages`). paho-mqtt's thread does the network; this
one reads documents and never waits for it.
"""

from __future__ import annotations

import json
import logging
import queue
import ssl
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.version import __version__
from tpmsd.interfaces.bridges.home_assistant import discovery
from tpmsd.interfaces.bridges.mqtt_messages import MAX_PAYLOAD_BYTES, Announcer, Message, Topics
from tpmsd.interfaces.bridges.summary import DaemonSummary, summarise

if TYPE_CHECKING:
    import paho.mqtt.client as paho

KEEPALIVE_S = 20
RECONNECT_S = (1, 30)
MAX_IN_FLIGHT, MAX_QUEUED = 20, 100
"""Messages that paho holds for a broker that does not acknowledge; what is beyond waits here, bounded too."""
RECALL_S = 2.0
"""Time that the broker may take to send retained messages after it has confirmed the subscription, s."""
CLOSE_S = 2.0


@dataclass(frozen=True, slots=True)
class MqttSettings:
    """Settings of the connection and the topics."""

    host: str
    port: int
    node: str = "car"
    """Name of the car in topics and identifiers."""
    base: str = "tpmsd"
    discovery_prefix: str = "homeassistant"
    """Prefix of the discovery topics; empty: no message to Home Assistant."""
    period_s: float = 10.0
    user: str | None = None
    password: str | None = None
    tls: ssl.SSLContext | None = None


def tls_context(ca: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """Return a context that verifies the broker; ConfigError for a file that is not a certificate or key."""
    try:
        context = ssl.create_default_context(cafile=None if ca is None else str(ca))
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        if certificate is not None:
            context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        names = ", ".join(str(path) for path in (ca, certificate, key) if path is not None)
        raise ConfigError(f"{names}: {error.strerror or error}") from None
    return context


class MqttBridge:
    """Bridge from the status of one daemon to the topics of one MQTT broker."""

    def __init__(self, settings: MqttSettings, log: logging.Logger) -> None:
        """ConfigError where paho-mqtt is not installed."""
        try:
            import paho.mqtt.client as paho
            from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
        except ImportError:
            raise ConfigError("paho-mqtt is not installed: pip install 'tpmsd[mqtt]'") from None
        self._settings, self._log = settings, log
        self._topics = Topics(f"{settings.base}/{settings.node}")
        self.announcer = Announcer(self._topics, settings.period_s)
        self._news: queue.SimpleQueue[tuple[str, bytes | None]] = queue.SimpleQueue()
        """Events from paho's thread: connected, subscribed, recalled, gone."""
        self._connected = False
        self._again = False
        self._subscribed_s: float | None = None
        self._available = False
        self._published_available: bool | None = None
        self._introduced: tuple[str, ...] = ()
        self._summary: DaemonSummary | None = None
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=f"tpmsd-{settings.node}")
        client.max_inflight_messages_set(MAX_IN_FLIGHT)
        client.max_queued_messages_set(MAX_QUEUED)
        client.reconnect_delay_set(*RECONNECT_S)
        client.will_set(self._topics.availability, "offline", qos=1, retain=True)
        if settings.user is not None:
            client.username_pw_set(settings.user, settings.password)
        if settings.tls is not None:
            client.tls_set_context(settings.tls)
        client.on_connect = self._on_connect
        client.on_connect_fail = self._on_connect_fail
        client.on_disconnect = self._on_disconnect
        client.on_subscribe = lambda *_: self._news.put(("subscribed", None))
        client.on_message = self._on_message
        self._client: paho.Client = client
        self._full = MQTTErrorCode.MQTT_ERR_QUEUE_SIZE

    def run(self, documents: Iterable[dict[str, Any] | None]) -> None:
        """Publish the documents until they end."""
        with self._network_loop():
            for document in documents:
                self.step(document, time.monotonic())

    def step(self, document: dict[str, Any] | None, now_s: float) -> None:
        """Process one document, and publish availability, state, alarms and events that are due."""
        self._available = document is not None
        if document is not None:
            self._summary = summarise(document)
            self.announcer.update(self._summary)
        self._handle_network_events(now_s)
        if not self._connected:
            return
        if self._published_available != self._available:
            availability = "online" if self._available else "offline"
            if self._publish(Message(self._topics.availability, availability, True)):
                self._published_available = self._available
        events = self.announcer.events
        while events and self._publish(events[0]):
            events.popleft()
        # Alarms follow their events: whoever was killed in between repeats the event rather than losing it.
        summary = self._summary
        if summary is None or not summary.ready or events or not self.announcer.is_ready:
            return
        self._publish_discovery(summary)
        done = [self._publish(message) for message in self.announcer.state(summary, now_s, self._again)]
        self._again = not all(done) if done else self._again

    def _publish_discovery(self, summary: DaemonSummary) -> None:
        """Announce the wheels to Home Assistant, when they are known and after every reconnection."""
        wheels = tuple(wheel.name for wheel in summary.wheels)
        settings = self._settings
        if not settings.discovery_prefix or not wheels or wheels == self._introduced:
            return
        messages = discovery(settings.discovery_prefix, settings.node, self._topics.base, __version__, wheels)
        if all(self._publish(Message(topic, json.dumps(config), True)) for topic, config in messages):
            self._introduced = wheels

    def _handle_network_events(self, now_s: float) -> None:
        """Handle connections, disconnections and recalled alarms that paho's thread has queued."""
        while True:
            try:
                what, payload = self._news.get_nowait()
            except queue.Empty:
                break
            if what == "connected":
                self._connected = self._again = True
                self._published_available, self._introduced = None, ()
                if not self.announcer.is_ready:
                    self._client.subscribe(self._topics.alarms, qos=1)
            elif what == "gone":
                self._connected, self._subscribed_s = False, None
            elif what == "subscribed":
                self._subscribed_s = now_s
            elif not self.announcer.is_ready:
                self.announcer.recall(payload)
                self._client.unsubscribe(self._topics.alarms)
        waited_s = None if self._subscribed_s is None else now_s - self._subscribed_s
        if waited_s is not None and waited_s >= RECALL_S and not self.announcer.is_ready:
            self.announcer.recall(None)
            self._client.unsubscribe(self._topics.alarms)

    def _publish(self, message: Message) -> bool:
        """Queue a message at paho; return False if its queue is full."""
        done = self._client.publish(message.topic, message.payload, message.qos, message.retain)
        return done.rc != self._full

    @contextmanager
    def _network_loop(self) -> Iterator[None]:
        """Run paho's network thread while the block runs."""
        settings = self._settings
        try:
            self._client.connect_async(settings.host, settings.port, KEEPALIVE_S)
        except ValueError as error:
            raise ConfigError(f"broker {settings.host}:{settings.port}: {error}") from None
        self._client.loop_start()
        try:
            yield
        finally:
            if self._connected:
                # An orderly end sends no last will.
                last = self._client.publish(self._topics.availability, "offline", qos=1, retain=True)
                end_s = time.monotonic() + CLOSE_S
                while not last.is_published() and time.monotonic() < end_s:
                    time.sleep(0.02)
            self._client.disconnect()
            self._client.loop_stop()

    def _on_connect(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            self._log.warning("the broker refuses: %s; trying again", reason)
            return
        self._log.info("connected to %s:%d", self._settings.host, self._settings.port)
        self._news.put(("connected", None))

    def _on_connect_fail(self, client: Any, data: Any) -> None:
        self._log.warning("%s:%d cannot be reached; trying again", self._settings.host, self._settings.port)

    def _on_disconnect(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        self._news.put(("gone", None))
        if reason.is_failure:
            self._log.warning("the broker is gone (%s); trying again", reason)

    def _on_message(self, client: Any, data: Any, message: Any) -> None:
        if message.topic == self._topics.alarms and message.retain:
            self._news.put(("recalled", bytes(message.payload[: MAX_PAYLOAD_BYTES + 1])))
