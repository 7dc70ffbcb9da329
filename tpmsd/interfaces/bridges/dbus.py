"""`tpmsd bridge dbus`: alarms as signals on D-Bus, and the state on request.

In: the status socket, a message bus. Out: signals `AlarmRaised`, `AlarmCleared`, `HealthChanged` of
`org.tpmsd.Tpmsd1`, and answers to `GetState`. An alarm counts as sent once the bus has taken its signal, so a
bus that is restarted loses none. A bridge remembers nothing over its own end: a new one raises again what
is active. So who listens drops what it received whenever the name gets another owner.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.bridges.summary import Alarm, DaemonSummary, summarise

if TYPE_CHECKING:
    from jeepney.io.blocking import DBusConnection

NAME = "org.tpmsd.Tpmsd1"
PATH = "/org/tpmsd/Tpmsd1"
ANSWER_S = 2.0
"""Time that the bus may take to give the name, s."""
MAX_CALLS = 50
"""Number of calls answered after one document; further ones wait in the socket."""
OWNER, ALREADY_OWNER = 1, 4
"""Answers to RequestName (D-Bus specification) that mean the name is ours."""

INTROSPECTION = f"""<!DOCTYPE node PUBLIC "-//freedesktop//DTD D-BUS Object Introspection 1.0//EN"
 "http://www.freedesktop.org/standards/dbus/1.0/introspect.dtd">
<node><interface name="{NAME}">
 <signal name="AlarmRaised"><arg name="kind" type="s"/><arg name="wheel" type="s"/><arg name="time" type="d"/>
  <arg name="deviation_mm" type="d"/><arg name="reason" type="s"/></signal>
 <signal name="AlarmCleared"><arg name="kind" type="s"/><arg name="wheel" type="s"/>
  <arg name="time" type="d"/></signal>
 <signal name="HealthChanged"><arg name="health" type="s"/></signal>
 <method name="GetState"><arg name="status_json" type="s" direction="out"/></method>
</interface></node>"""


class DbusBridge:
    """Bridge from the status of one daemon to the signals and properties of one D-Bus."""

    def __init__(self, bus: str, log: logging.Logger) -> None:
        """`bus`: 'system', 'session' or an address such as 'unix:path=/run/bus'.

        ConfigError where jeepney is not installed or the address is none.
        """
        try:
            from jeepney.bus import get_bus
        except ImportError:
            raise ConfigError("jeepney is not installed: pip install 'tpmsd[dbus]'") from None
        self._address = bus.upper() if bus in ("system", "session") else bus
        try:
            get_bus(self._address)
        except KeyError:
            raise ConfigError("no session bus: DBUS_SESSION_BUS_ADDRESS is not set") from None
        except (ValueError, RuntimeError, StopIteration):
            raise ConfigError(f"--bus {bus!r}: system, session, or unix:path=...") from None
        self._log = log
        self._connection: DBusConnection | None = None
        self._said = ""
        self._alarms: dict[str, Alarm] = {}
        self._health = ""
        self._document: dict[str, Any] = {}

    def run(self, documents: Iterable[dict[str, Any] | None]) -> None:
        """Publish the documents until they end."""
        try:
            for document in documents:
                self.step(document)
        finally:
            self._close()

    def step(self, document: dict[str, Any] | None) -> None:
        """Send what is new in one document as signals, and answer calls."""
        self._document = document or {}
        try:
            self._connect()
            if document is None:
                self._signal_health_change("no daemon")
            else:
                self._signal_alarm_changes(summarise(document))
            self._answer_calls()
        except (OSError, EOFError, ConnectionError) as error:
            self._close()
            self._warn_once(f"the bus does not answer: {error}")

    def _signal_alarm_changes(self, summary: DaemonSummary) -> None:
        if not summary.ready:
            return
        active = {alarm.key: alarm for alarm in summary.alarms}
        for key in [key for key in self._alarms if key not in active]:
            self._send("AlarmCleared", "ssd", _alarm_identity(self._alarms[key]))
            del self._alarms[key]
        for key, alarm in active.items():
            if key not in self._alarms:
                what = (*_alarm_identity(alarm), _or_nan(alarm.deviation_mm), alarm.reason)
                self._send("AlarmRaised", "ssdds", what)
                self._alarms[key] = alarm
        self._signal_health_change(summary.health)

    def _signal_health_change(self, health: str) -> None:
        if health != self._health:
            self._send("HealthChanged", "s", (health,))
            self._health = health

    def _send(self, name: str, signature: str, body: tuple[Any, ...]) -> None:
        from jeepney import DBusAddress, new_signal

        assert self._connection is not None
        emitter = DBusAddress(PATH, interface=NAME)
        self._connection.send(new_signal(emitter, name, signature, body))

    def _connect(self) -> None:
        if self._connection is not None:
            return
        from jeepney import message_bus
        from jeepney.io.blocking import open_dbus_connection
        from jeepney.wrappers import DBusErrorResponse, unwrap_msg

        self._connection = open_dbus_connection(self._address)
        reply = self._connection.send_and_get_reply(message_bus.RequestName(NAME), timeout=ANSWER_S)
        try:
            (answer,) = unwrap_msg(reply)
        except DBusErrorResponse as error:
            raise ConfigError(
                f"the bus refuses the name {NAME} ({error.name}): install contrib/dbus/{NAME}.conf"
            ) from None
        if answer not in (OWNER, ALREADY_OWNER):
            raise ConfigError(f"another program on the bus has the name {NAME}")
        self._log.info("on the bus as %s", NAME)
        self._said = ""

    def _answer_calls(self) -> None:
        """Answer the method calls received so far, `MAX_CALLS` at most."""
        from jeepney import HeaderFields, MessageType, new_error, new_method_return

        connection = self._connection
        assert connection is not None
        for _ in range(MAX_CALLS):
            try:
                call = connection.receive(timeout=0)
            except TimeoutError:
                return
            if call.header.message_type is not MessageType.method_call:
                continue
            member = call.header.fields.get(HeaderFields.member)
            texts = {"GetState": json.dumps(self._document), "Introspect": INTROSPECTION}
            if member in texts:
                connection.send(new_method_return(call, "s", (texts[member],)))
            else:
                connection.send(new_error(call, "org.freedesktop.DBus.Error.UnknownMethod"))

    def _close(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None

    def _warn_once(self, text: str) -> None:
        if text != self._said:
            self._log.warning("%s; trying again", text)
        self._said = text


def _alarm_identity(alarm: Alarm) -> tuple[str, str, float]:
    """Return kind, wheel and time: equal in every signal about the same alarm."""
    return alarm.kind, alarm.wheel or "", _or_nan(alarm.time_s)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
