"""`[gnss] source` taken apart, and what is no source."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import REPO
from tests.onboard.daemon.fakes import VEHICLE
from tpmsd.car.config.gnss_source import GnssSource, parse_source, source_of
from tpmsd.car.config.model import GnssConfig
from tpmsd.car.config.problems import BadValueError
from tpmsd.interfaces.cli.main import main


@pytest.mark.parametrize(
    ("text", "source", "label"),
    [
        ("serial:/dev/ttyACM0", GnssSource("serial", path="/dev/ttyACM0"), "/dev/ttyACM0"),
        ("serial:///dev/ttyACM0", GnssSource("serial", path="/dev/ttyACM0"), "/dev/ttyACM0"),
        ("serial:COM3", GnssSource("serial", path="COM3"), "COM3"),
        ("gpsd://localhost", GnssSource("gpsd", host="localhost", port=2947), "gpsd://localhost:2947"),
        ("gpsd://10.0.0.2:3000", GnssSource("gpsd", host="10.0.0.2", port=3000), "gpsd://10.0.0.2:3000"),
        ("tcp://[::1]:10110", GnssSource("tcp", host="::1", port=10110), "tcp://[::1]:10110"),
        (" udp://0.0.0.0:10110 ", GnssSource("udp", host="0.0.0.0", port=10110), "udp://0.0.0.0:10110"),
        ("can", GnssSource("can"), "on CAN"),
    ],
)
def test_sources_are_taken_apart(text: str, source: GnssSource, label: str) -> None:
    """Each kind of source gives its device, or its host and port."""
    assert (source, label) == (parse_source(text), parse_source(text).label)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "not a source of fixes"),
        ("/dev/ttyACM0", "not a source of fixes"),
        ("http://localhost:80", "not a source of fixes"),
        ("gpsd:localhost", "no host and port"),
        ("serial:", "a serial line without a device"),
        ("serial://", "a serial line without a device"),
        ("tcp://localhost", "no port"),
        ("tcp://:10110", "no host"),
        ("udp://host:0", "not a port"),
        ("udp://host:65536", "not a port"),
        ("tcp://host:²", "not a port"),
        ("gpsd://host:2947/dev/ttyS0", "nothing may follow the port"),
        ("tcp://bad host:1", "not a host's name"),
        ("CAN", "not a source of fixes"),
    ],
)
def test_what_is_no_source_is_refused_with_the_reason(text: str, what: str) -> None:
    """Nonsense is refused in words that say what is wrong."""
    with pytest.raises(BadValueError) as refused:
        parse_source(text)

    assert what == refused.value.what


def test_a_device_alone_is_a_serial_source() -> None:
    """The older key `device` still names a serial line; without both keys there is no receiver."""
    assert GnssSource("serial", path="/dev/ttyS1") == source_of(GnssConfig("/dev/ttyS1"))
    assert source_of(GnssConfig()) is None


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ('source = "tcp://localhost"', "[gnss] source: no port"),
        ('source = "can"', "[gnss] source: no signal of gnss_latitude gnss_longitude"),
        ('device = "/dev/ttyS1"\nsource = "gpsd://localhost"', "[gnss] source: given as well as device"),
        ("source = 3", "[gnss] source: not a text"),
    ],
)
def test_check_names_line_and_reason(
    lines: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`tpmsd check` refuses a source that cannot be: file, line, key and reason in one line, exit code 2."""
    text = VEHICLE.format(channel="can0") + f"\n[gnss]\n{lines}\n"
    (tmp_path / "vehicle.toml").write_text(text, "utf-8")
    (tmp_path / "bus.dbc").write_text((REPO / "dbc" / "tpmsd.dbc").read_text("utf-8"), "utf-8")
    number = 1 + next(k for k, line in enumerate(text.splitlines()) if line.startswith("source"))

    assert 2 == main(["check", str(tmp_path / "vehicle.toml")])
    assert f"vehicle.toml:{number}: {said}" in capsys.readouterr().err
