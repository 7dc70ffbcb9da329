"""The JSON Schema of vehicle.toml says of each value what the program itself says of it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.car.config.conftest import GOOD_TOML
from tpmsd.car.config.json_schema import vehicle_schema
from tpmsd.car.config.load import load_config
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.interfaces.cli.main import main

SCHEMA = vehicle_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
FITTING = Path(__file__).resolve().parents[3] / "docs" / "tutorial" / "fitting.md"
EXTRA = """
[can.buses]
body = { channel = "can1", dbc = "body.dbc" }
[filter]
method = "mpf-pn"
gate = "slip"
measurements = ["position", "course"]
[tyre]
size = "205/55R16"
[alarms]
status_id = 0x6F0
[notify]
command = ["/bin/true"]
"""


def test_it_is_a_schema() -> None:
    """The document is itself valid, and `check --schema` prints it."""
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_check_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    """`tpmsd check --schema` takes no configuration."""
    assert 0 == main(["check", "--schema"])
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(SCHEMA))


@pytest.mark.parametrize("text", [GOOD_TOML, GOOD_TOML + EXTRA])
def test_good_configurations_are_valid(text: str) -> None:
    """What the program takes the schema takes."""
    VALIDATOR.validate(tomllib.loads(text))


def test_the_written_configurations_are_valid(tmp_path: Path) -> None:
    """What `simulate` and `init` write is valid."""
    assert 0 == main(["simulate", str(tmp_path / "drive"), "--duration", "20"])
    VALIDATOR.validate(tomllib.loads((tmp_path / "drive" / "vehicle.toml").read_text()))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("wheel_radius_m = 0.316", "wheel_radius_m = 316"),
        ("wheel_radius_m = 0.316", 'wheel_radius_m = "0.316"'),
        ("wheel_radius_m = 0.316", "wheel_radius_m = { fl = 0.3, xx = 0.3 }"),
        ("track_front_m = 1.53", "track_fron_m = 1.53"),
        ('driven_axle = "front"', 'driven_axle = "both"'),
        ("teeth_per_rev = 48", "teeth_per_rev = 0"),
        ("baud = 115200", "baud = 115200.5"),
        ('device = "/dev/ttyACM0"', 'device = "gpsd://localhost"'),
        ('"WHEELS.CNT_FL"', '"CNT_FL"'),
        ('"WHEELS.CNT_FL"', "{ modulus = 1001 }"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", unit = "km/h" }'),
        ("wheel_count_fl", "wheel_counter_fl"),
        ("[gnss]", "[gps]"),
    ],
)
def test_what_the_program_refuses_the_schema_refuses(tmp_path: Path, old: str, new: str) -> None:
    """A wrong type, range, unit, key, table or name is refused by both."""
    assert old in GOOD_TOML
    text = GOOD_TOML.replace(old, new, 1)
    file = tmp_path / "vehicle.toml"
    file.write_text(text, encoding="utf-8")
    (tmp_path / "bus.dbc").touch()

    with pytest.raises(ConfigProblems):
        load_config(file)
    found: list[Any] = list(VALIDATOR.iter_errors(tomllib.loads(text)))
    assert found != []
