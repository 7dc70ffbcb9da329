"""Source of fixes: `[gnss] source` taken apart.

In: the text of the configuration. Out: `GnssSource`, or `BadValueError` with what is wrong and what is
allowed. Nothing is looked up: whether a host exists shows when it is opened. All other keys of [gnss]
stand in `schema`, their defaults in `model.GnssConfig`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from tpmsd.car.config.model import GnssConfig
from tpmsd.car.config.problems import STEERS, BadValueError, show

ALLOWED = "serial:PATH | gpsd://HOST:PORT | tcp://HOST:PORT | udp://HOST:PORT | can"
GPSD_PORT = 2947
"""IANA's number for gpsd."""

_NETWORK = re.compile(
    r"(?P<kind>gpsd|tcp|udp)://(?P<host>\[[^\]]*\]|[^:/\[\]]*)(?::(?P<port>[^/]*))?(?P<rest>/.*)?"
)
_HOST = re.compile(
    r"[A-Za-z0-9](?:[A-Za-z0-9.\-]{0,252}[A-Za-z0-9])?|[0-9A-Fa-f:.]{2,45}(?:%[A-Za-z0-9.\-_]+)?"
)
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.\-]*):")


@dataclass(frozen=True, slots=True)
class GnssSource:
    """One source of fixes."""

    kind: str
    """serial | gpsd | tcp | udp | can"""
    path: str = ""
    """Device of a serial line."""
    host: str = ""
    port: int = 0

    @property
    def label(self) -> str:
        """Return the source as messages name it: a device, `on CAN`, or an address."""
        if self.kind == "serial":
            return self.path
        if self.kind == "can":
            return "on CAN"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}://{host}:{self.port}"


def parse_source(text: str) -> GnssSource:
    """Return `[gnss] source` in its parts; `BadValueError` if it is not a source."""
    text = text.strip()
    if text == "can":
        return GnssSource("can")
    if text.startswith("serial:"):
        path = text.removeprefix("serial:")
        path = path.removeprefix("//") if path.startswith("///") else path
        if not path or path.startswith("//") or "\0" in path:
            raise BadValueError("a serial line without a device", show(text), "serial:/dev/ttyACM0")
        return GnssSource("serial", path=path)
    match = _NETWORK.fullmatch(text)
    if match is None:
        scheme = _SCHEME.match(text)
        known = scheme is not None and scheme[1] in ("gpsd", "tcp", "udp")
        what = "no host and port" if known else "not a source of fixes"
        suggestion = f"serial:{text}" if text.startswith("/") else None
        raise BadValueError(what, show(text), ALLOWED, suggestion)
    return _network_source(text, match)


def _network_source(text: str, match: re.Match[str]) -> GnssSource:
    """Return the source of a URL such as gpsd://localhost:2947; BadValueError for a wrong host or port."""
    kind, host, port_text = match["kind"], match["host"], match["port"]
    example = f"{kind}://localhost:{GPSD_PORT if kind == 'gpsd' else 10110}"
    if match["rest"]:
        raise BadValueError("nothing may follow the port", show(text), example)
    host = host.strip("[]")
    if not host or _HOST.fullmatch(host) is None:
        raise BadValueError("no host" if not host else "not a host's name", show(text), example)
    if port_text is None and kind == "gpsd":
        return GnssSource(kind, host=host, port=GPSD_PORT)
    if not port_text:
        raise BadValueError("no port", show(text), example)
    if not (port_text.isascii() and port_text.isdigit()) or not 1 <= int(port_text[:6]) <= 65535:
        raise BadValueError("not a port", show(port_text), "1 to 65535")
    return GnssSource(kind, host=host, port=int(port_text))


@dataclass(frozen=True, slots=True)
class SourceRule:
    """The rule of the key `[gnss] source`."""

    def read(self, value: object) -> str:
        """Return the source without blanks around it."""
        if not isinstance(value, str):
            raise BadValueError("not a text", show(value), ALLOWED)
        if STEERS.search(value.strip()):
            raise BadValueError("it holds control characters", show(value), ALLOWED)
        parse_source(value)
        return value.strip()


@dataclass(frozen=True, slots=True)
class DeviceRule:
    """The rule of the key `[gnss] device`: a serial line, no address."""

    def read(self, value: object) -> str:
        """Return the path without blanks around it."""
        allowed = "a serial line such as /dev/ttyACM0"
        if not isinstance(value, str) or not value.strip() or STEERS.search(value):
            raise BadValueError("not a serial line", show(value), allowed)
        if "://" in value:
            parse_source(value)
            raise BadValueError(
                "an address, not a serial line", show(value), allowed, f"source = {show(value)}"
            )
        return value.strip()


def source_of(gnss: GnssConfig) -> GnssSource | None:
    """Return the configured source: `source`, else the serial line `device`; None where there is neither."""
    if gnss.source is not None:
        return parse_source(gnss.source)
    return None if gnss.device is None else GnssSource("serial", path=gnss.device)
