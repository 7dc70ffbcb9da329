"""`tpmsd bridge mqtt | prometheus | dbus | vss`: the daemon's state to other systems, in its own process.

In: the daemon's status socket. Out: MQTT messages, metrics over HTTP, D-Bus signals, or signals of the
Vehicle Signal Specification, until SIGTERM or Ctrl-C. `vss --input` goes the other way: wheel speeds of a
databroker onto a CAN bus.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import re
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.daemon_socket import add_socket_options, daemon_socket
from tpmsd.interfaces.cli.output import Subparsers

if TYPE_CHECKING:
    from tpmsd.interfaces.bridges.dbus import DbusBridge
    from tpmsd.interfaces.bridges.mqtt import MqttBridge, MqttSettings
    from tpmsd.interfaces.bridges.vss import VssBridge
    from tpmsd.interfaces.bridges.vss_connection import DatabrokerSettings

MQTT_PORT, MQTT_TLS_PORT, METRICS_PORT = 1883, 8883, 9838
CREDENTIAL = "tpmsd-mqtt-password"
VSS_PORT, VSS_CREDENTIAL = 55555, "tpmsd-vss-token"
_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
_TOPIC = re.compile(r"[A-Za-z0-9_./-]{1,128}")

_DESCRIPTION = """\
Hands the daemon's state and alarms to another system. A bridge is a process of its own: it reads the status
socket, and the daemon neither knows nor waits for it. Each needs a package: pip install 'tpmsd[mqtt]',
'tpmsd[prometheus]', 'tpmsd[dbus]' or 'tpmsd[vss]'.
"""
_EPILOG = f"""\
examples:
  tpmsd bridge mqtt --broker localhost
  tpmsd bridge mqtt --broker mqtt.example.org --ca ca.pem --user car --password-file /etc/tpmsd/mqtt-password
  tpmsd bridge prometheus                      metrics on http://127.0.0.1:{METRICS_PORT}/metrics
  tpmsd bridge dbus                            signals of org.tpmsd.Tpmsd1 on the system bus
  tpmsd bridge vss --databroker localhost      Tire.IsPressureLow of each wheel to a KUKSA databroker
  tpmsd bridge vss --print-dbc > vss.dbc
  tpmsd bridge vss --databroker localhost --input vcan0    its wheel speeds and position, as frames of vss.dbc

A password or token comes from a file, or from the systemd credential {CREDENTIAL} or {VSS_CREDENTIAL};
never from the command line.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        "bridge",
        help="hand state and alarms to MQTT (Home Assistant), Prometheus, D-Bus or VSS (KUKSA)",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    kinds = parser.add_subparsers(title="bridges", metavar="BRIDGE", dest="bridge", required=True)
    mqtt = kinds.add_parser("mqtt", help="publish to an MQTT broker, with Home Assistant's discovery")
    mqtt.add_argument("--broker", metavar="HOST[:PORT]", required=True, help="the broker")
    mqtt.add_argument(
        "--node", metavar="NAME", default="car", help="name of the car in topics (default: car)"
    )
    mqtt.add_argument(
        "--base", metavar="TOPIC", default="tpmsd", help="topics begin with it (default: tpmsd)"
    )
    mqtt.add_argument(
        "--discovery",
        metavar="PREFIX",
        default="homeassistant",
        help="Home Assistant's discovery prefix, '' for none (default: homeassistant)",
    )
    mqtt.add_argument("--period", metavar="S", type=float, default=10.0, help="numbers every S seconds (10)")
    mqtt.add_argument("--user", metavar="NAME", help="user name")
    mqtt.add_argument("--password-file", metavar="FILE", type=Path, help="file with the password")
    mqtt.add_argument("--tls", action="store_true", help="TLS with the system's authorities")
    mqtt.add_argument("--ca", metavar="FILE", type=Path, help="TLS with this authority (PEM)")
    mqtt.add_argument("--cert", metavar="FILE", type=Path, help="certificate of this client (PEM)")
    mqtt.add_argument("--key", metavar="FILE", type=Path, help="its key (PEM)")
    metrics = kinds.add_parser("prometheus", help="serve /metrics")
    metrics.add_argument("--listen", metavar="ADDRESS", default="127.0.0.1", help="default: 127.0.0.1")
    metrics.add_argument(
        "--port", metavar="PORT", type=int, default=METRICS_PORT, help=f"default: {METRICS_PORT}"
    )
    dbus = kinds.add_parser("dbus", help="alarms as signals on D-Bus")
    dbus.add_argument(
        "--bus", metavar="BUS", default="system", help="system, session or unix:path=... (default: system)"
    )
    vss = kinds.add_parser(
        "vss",
        help="soft tyres to a KUKSA databroker (Vehicle Signal Specification), or its wheel speeds to us",
    )
    vss.add_argument("--databroker", metavar="HOST[:PORT]", help=f"the databroker (default port: {VSS_PORT})")
    vss.add_argument(
        "--period", metavar="S", type=float, default=10.0, help="all values every S seconds (10)"
    )
    vss.add_argument(
        "--input",
        metavar="CHANNEL",
        help="the other way: wheel speeds and position onto this CAN interface, a vcan",
    )
    vss.add_argument(
        "--interface",
        metavar="NAME",
        default="socketcan",
        help="of --input, by python-can (default: socketcan)",
    )
    vss.add_argument("--print-dbc", action="store_true", help="print the DBC of --input's frames and end")
    vss.add_argument("--ca", metavar="FILE", type=Path, help="TLS with this authority (PEM)")
    vss.add_argument("--token-file", metavar="FILE", type=Path, help="file with the databroker's token")
    for kind in (mqtt, metrics, dbus, vss):
        add_socket_options(kind)
        kind.add_argument("-v", "--verbose", action="store_true", help="log more")


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd bridge` until a signal stops it; return the exit code."""
    from tpmsd.onboard.daemon.journal import set_up_logging

    if args.bridge == "vss" and args.print_dbc:
        from tpmsd.interfaces.bridges.vss_frames import vss_dbc

        print(vss_dbc(), end="")
        return 0
    log = set_up_logging(args.verbose)
    if args.bridge == "vss" and args.input is not None:
        return _run_vss_input(args, log)
    path = daemon_socket(args)
    if args.bridge == "prometheus":
        from tpmsd.interfaces.bridges.prometheus import serve

        if not 0 <= args.port <= 65535:
            raise ConfigError(f"--port {args.port} is no port (0 to 65535)")
        stopped = threading.Event()
        port, end = serve(path, args.listen, args.port, log)
        log.info("serving http://%s:%d/metrics", args.listen, port)
        with _until_signalled(stopped):
            stopped.wait()
        end()
        return 0
    from tpmsd.interfaces.bridges.status_stream import follow_status

    bridge = _make_bridge(args, log)
    with contextlib.suppress(_Stop, KeyboardInterrupt), _until_signalled(None):
        bridge.run(follow_status(path, log))
    return 0


def _make_bridge(args: argparse.Namespace, log: logging.Logger) -> MqttBridge | DbusBridge | VssBridge:
    if args.bridge == "dbus":
        from tpmsd.interfaces.bridges.dbus import DbusBridge

        return DbusBridge(args.bus, log)
    if args.bridge == "vss":
        return _make_vss_bridge(args, log)
    from tpmsd.interfaces.bridges.mqtt import MqttBridge

    return MqttBridge(_mqtt_settings(args), log)


def _make_vss_bridge(args: argparse.Namespace, log: logging.Logger) -> VssBridge:
    from tpmsd.interfaces.bridges.vss import VssBridge

    _check_period(args.period)
    return VssBridge(_databroker_settings(args), log, args.period)


def _run_vss_input(args: argparse.Namespace, log: logging.Logger) -> int:
    from tpmsd.interfaces.bridges.can_wire import CanWire
    from tpmsd.interfaces.bridges.vss_input import VssInput

    source = VssInput(_databroker_settings(args), CanWire(args.interface, args.input, log), log)
    with contextlib.suppress(_Stop, KeyboardInterrupt), _until_signalled(None):
        source.run()
    return 0


def _databroker_settings(args: argparse.Namespace) -> DatabrokerSettings:
    from tpmsd.interfaces.bridges.secrets import read_secret
    from tpmsd.interfaces.bridges.vss_connection import DatabrokerSettings

    if args.databroker is None:
        raise ConfigError("--databroker HOST is needed")
    host, port = _parse_address("--databroker", args.databroker, VSS_PORT)
    token = read_secret(args.token_file, VSS_CREDENTIAL, os.environ)
    if token is not None and args.ca is None:
        _refuse_cleartext("a token", host, "--ca")
    return DatabrokerSettings(host, port, args.ca, token)


class _Stop(BaseException):
    """SIGTERM came; no `Exception`, which a bridge survives: frames that a bus refuses, for one."""


@contextlib.contextmanager
def _until_signalled(stopped: threading.Event | None) -> Iterator[None]:
    """Make SIGTERM and SIGINT set the event, or raise `_Stop` where there is none."""

    def handle(number: int, _: object) -> None:
        if stopped is None:
            raise _Stop
        stopped.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _mqtt_settings(args: argparse.Namespace) -> MqttSettings:
    from tpmsd.interfaces.bridges.mqtt import MqttSettings, tls_context
    from tpmsd.interfaces.bridges.secrets import read_secret

    for option, value, pattern in (("--node", args.node, _NAME), ("--base", args.base, _TOPIC)):
        if pattern.fullmatch(value) is None:
            raise ConfigError(f"{option} {value!r}: letters, digits, _ and - (and / . in topics) make a name")
    if args.discovery and _TOPIC.fullmatch(args.discovery) is None:
        raise ConfigError(f"--discovery {args.discovery!r} is no topic")
    _check_period(args.period)
    if (args.cert is None) != (args.key is None):
        raise ConfigError("--cert and --key go together")
    tls = args.tls or args.ca is not None or args.cert is not None
    host, port = _parse_address("--broker", args.broker, MQTT_TLS_PORT if tls else MQTT_PORT)
    password = read_secret(args.password_file, CREDENTIAL, os.environ)
    if password is not None and args.user is None:
        raise ConfigError("a password without --user")
    if password is not None and not tls:
        _refuse_cleartext("a password", host, "--tls or --ca")
    return MqttSettings(
        host=host,
        port=port,
        node=args.node,
        base=args.base.strip("/"),
        discovery_prefix=args.discovery.strip("/"),
        period_s=args.period,
        user=args.user,
        password=password,
        tls=tls_context(args.ca, args.cert, args.key) if tls else None,
    )


def _check_period(period_s: float) -> None:
    if not 0.1 <= period_s <= 86400.0:
        raise ConfigError(f"--period {period_s:g}: 0.1 to 86400 s")


def _refuse_cleartext(what: str, host: str, options: str) -> None:
    """Raise ConfigError if a secret would go to another host without TLS."""
    if host not in ("localhost", "127.0.0.1", "::1"):
        raise ConfigError(f"{what} to {host} without TLS: others on the network could read it ({options})")


def _parse_address(option: str, text: str, default_port: int) -> tuple[str, int]:
    match = re.fullmatch(r"(?:\[([0-9A-Fa-f:.]+)\]|([A-Za-z0-9.\-]+))(?::(\d{1,5}))?", text)
    port = default_port if match is None or match[3] is None else int(match[3])
    if match is None or not 1 <= port <= 65535:
        raise ConfigError(f"{option} {text!r}: HOST or HOST:PORT")
    return match[1] or match[2], port
