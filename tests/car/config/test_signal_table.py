"""The table form of a signal, further buses, teeth by wheel, and what is wrong with them."""

from __future__ import annotations

import pytest

from tests.car.config.conftest import Make
from tpmsd.car.config.check import check
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Condition, SignalOptions
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.onboard.daemon.config_toml import config_toml

TABLE = (
    '"WHEELS.CNT_FL"',
    '{ signal = "WHEELS.CNT_FL", modulus = 1001, invalid = [1023], valid_when = "ESP.AY >= 0x2",'
    ' sign = "ESP.YAW", scale = 0.5, bus = "can1" }',
)
BUSES = ('dbc = "bus.dbc"\n', 'dbc = "bus.dbc"\nbuses = { can1 = { channel = "can7" }, can2 = "can8" }\n')
TEETH = ("teeth_per_rev = 48", "teeth_per_rev = { fl = 48, fr = 48, rl = 44, rr = 44 }")


def test_all_that_a_table_can_say(make: Make) -> None:
    """Every key of the table form arrives in the record, and the name where names are."""
    can = load_config(make(TABLE, BUSES)).can

    assert "WHEELS.CNT_FL" == can.signals["wheel_count_fl"]
    assert {
        "wheel_count_fl": SignalOptions(
            modulus=1001,
            invalid=(1023,),
            valid_when=Condition("ESP.AY", ">=", 2.0),
            backward_when=Condition("ESP.YAW", "!=", 0.0),
            scale=0.5,
            bus="can1",
        )
    } == can.options
    assert ["can7", "can8"] == [bus.channel for bus in can.buses.values()]
    assert (1, 0) == (can.bus_number("wheel_count_fl"), can.bus_number("yaw_rate"))


def test_teeth_by_wheel(make: Make) -> None:
    """Wheels with different rings have each their number; equal numbers are one number."""
    vehicle = load_config(make(TEETH)).vehicle
    assert [48, 48, 44, 44] == [vehicle.teeth(wheel) for wheel in range(4)]

    same = load_config(make(("teeth_per_rev = 48", "teeth_per_rev = { fl = 44, fr = 44, rl = 44, rr = 44 }")))
    assert (44.0, None) == (same.vehicle.teeth_per_rev, same.vehicle.teeth_by_wheel)


def test_a_recording_holds_the_tables(make: Make) -> None:
    """What a recording writes down of a configuration with tables reads back as the same configuration."""
    path = make(
        TABLE, BUSES, TEETH, ('rate = "ESP.YAW"', 'rate = { signal = "ESP.YAW", sign = -1, unit = "rad/s" }')
    )
    config = load_config(path)
    path.write_text(config_toml(config, "bus.dbc"), encoding="utf-8")
    again = load_config(path)

    assert (config.can, config.vehicle) == (again.can, again.vehicle)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", moduls = 5 }', "moduls: unknown key"),
        ('"WHEELS.CNT_FL"', "{ modulus = 5 }", "signal: missing"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", modulus = 1 }', "modulus: out of range"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", modulus = 65537 }', "modulus: out of range"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", valid_when = "ESP.AY" }', "not a comparison"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", valid_when = "ESP.AZ == 1" }', "no signal AZ"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", bus = "can1" }', "bus: no such bus"),
        ('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL", sign = 2 }', "sign: not a sign"),
        ('"ESP.YAW"', '{ signal = "ESP.YAW", unit = "furlong" }', "unit: an unknown unit"),
        ('"ESP.YAW"', '{ signal = "ESP.YAW", scale = 0 }', "scale: a signal of scale 0"),
        ('"ESP.YAW"', '{ signal = "ESP.YAW", modulus = 9 }', "modulus: unknown key"),
        ("teeth_per_rev = 48", "teeth_per_rev = { fl = 48, fx = 3 }", "no such wheel fx"),
        ("teeth_per_rev = 48", "teeth_per_rev = { fl = 48 }", "no number of fr rl rr"),
        ("[can]\n", "[can]\nbuses = 3\n", "must be a table"),
        ("[can]\n", "[can]\nbuses = { a = {} }\n", "channel: missing"),
    ],
)
def test_mistakes_in_tables(make: Make, old: str, new: str, what: str) -> None:
    """Each mistake is one line that names the key within the table."""
    (problem,) = check(make((old, new))).problems
    assert what in problem.text


def test_the_greatest_value_of_the_dbc_is_a_hint(make: Make) -> None:
    """A counter whose greatest value in the DBC needs all its bits rolls over behind it; check says so."""
    path = make(dbc=(("SG_ CNT_FL : 0|16@1+ (1,0) [0|65535]", "SG_ CNT_FL : 0|10@1+ (1,0) [0|1000]"),))
    (warning,) = check(path).warnings
    assert "WHEELS.CNT_FL rolls over at 1001" in warning.what

    lesser = make(dbc=(("SG_ CNT_FL : 0|16@1+ (1,0) [0|65535]", "SG_ CNT_FL : 0|16@1+ (1,0) [0|1000]"),))
    assert () == check(lesser).warnings


def test_every_role_of_the_bus_is_known(make: Make) -> None:
    """Flags need no unit; a receiver on CAN has roles with units of its own."""
    path = make(('"ESP.YAW"', '"ESP.YAW"\nabs_active = "ESP.AY"\ngnss_latitude = "SPEEDS.V_FL"'))
    (problem,) = check(path).problems
    assert "[can.signals] gnss_latitude" == problem.key
    assert "linear speed" in problem.what


def test_mixed_wheels_still_need_all(make: Make) -> None:
    """A wheel given as a table is a wheel."""
    with pytest.raises(ConfigProblems, match="wheel_count_fl"):
        load_config(make(('wheel_count_fl = "WHEELS.CNT_FL"\n', "")))
    assert load_config(make(('"WHEELS.CNT_FL"', '{ signal = "WHEELS.CNT_FL" }'))).can.options == {}
