"""From TOML to the records, and what is said where that fails."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.car.config.conftest import GOOD_TOML, Make
from tpmsd.car.config import model
from tpmsd.car.config.load import ConfigProblems, load_config
from tpmsd.car.config.problems import Problem, shown_lines
from tpmsd.car.config.schema import tables
from tpmsd.foundation.errors import ConfigError

RECORDINGS = ("rav4-suburb-60s", "van-motorway-a", "van-motorway-b", "van-oval")


def problems_of(path: Path, dbc: Path | None = None) -> tuple[Problem, ...]:
    """All problems; each must be one printable line that starts with the file."""
    with pytest.raises(ConfigProblems) as caught:
        load_config(path, dbc)
    assert isinstance(caught.value, ConfigError)
    assert caught.value.exit_code == 2
    assert str(caught.value).splitlines() == shown_lines(caught.value.problems)
    assert all(problem.text.isprintable() for problem in caught.value.problems)
    return caught.value.problems


def line_number(path: Path, start: str) -> int:
    """Where the line that starts so is, found without the code under test."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(number for number, line in enumerate(lines, 1) if line.startswith(start))


def test_good_file(make: Make) -> None:
    """Every value of the contract's tables arrives in its record."""
    path = make()
    config = load_config(path)
    assert config.vehicle == model.VehicleConfig(
        wheel_radius_m=(0.316, 0.316, 0.316, 0.316),
        track_rear_m=1.52,
        track_front_m=1.53,
        wheelbase_m=2.63,
        driven_axle="front",
        steering_ratio=15.3,
        teeth_per_rev=48.0,
    )
    assert config.can == model.CanConfig(
        signals={
            "wheel_count_fl": "WHEELS.CNT_FL",
            "wheel_count_fr": "WHEELS.CNT_FR",
            "wheel_count_rl": "WHEELS.CNT_RL",
            "wheel_count_rr": "WHEELS.CNT_RR",
            "yaw_rate": "ESP.YAW",
        },
        dbc=path.parent / "bus.dbc",
        interface="socketcan",
        channel="can0",
    )
    assert config.gnss == model.GnssConfig("/dev/ttyACM0", baud=115200)
    assert path == config.file


def test_left_out_tables_have_the_defaults(make: Make) -> None:
    """Tables that a drive folder does not have come from the model's defaults."""
    config = load_config(make())
    assert config == dataclasses.replace(
        config,
        filter=model.FilterConfig(),
        monitor=model.MonitorConfig(),
        alarms=model.AlarmsConfig(),
        status=model.StatusConfig(),
        state=model.StateConfig(),
    )


def test_own_tables(make: Make) -> None:
    """The tables beyond the contract are read, paths relative to the file's folder."""
    own = (
        "\n[filter]\nrate_hz = 50\nparticles = 200\n[monitor]\nraise_hold_s = 0\n"
        "[alarms]\nstatus_id = 0x18FF0001\n"
        'alarm_id = 0x18FF0002\nextended_ids = true\nchannel = 1\n[status]\nsocket = "s.sock"\nmode = 0o600\n'
        '[state]\nfile = ""\n'
    )
    path = make(text=GOOD_TOML + own)
    config = load_config(path)
    assert (config.filter.rate_hz, config.filter.particles, config.monitor.raise_hold_s) == (50.0, 200, 0.0)
    assert isinstance(config.filter.rate_hz, float)
    assert config.alarms == model.AlarmsConfig(
        status_id=0x18FF0001, alarm_id=0x18FF0002, extended_ids=True, channel="1"
    )
    assert config.status == model.StatusConfig(path.parent / "s.sock", 0o600)
    assert config.state.file is None


def test_schema_and_records_have_the_same_keys() -> None:
    """A field without a rule, or a rule without a field, cannot creep in."""
    records: dict[str, Any] = {
        "vehicle": model.VehicleConfig,
        "can": model.CanConfig,
        "gnss": model.GnssConfig,
        "obd": model.ObdConfig,
        "filter": model.FilterConfig,
        "monitor": model.MonitorConfig,
        "tyre": model.TyreConfig,
        "alarms": model.AlarmsConfig,
        "status": model.StatusConfig,
        "state": model.StateConfig,
        "notify": model.NotifyConfig,
        "calibration": model.CalibrationConfig,
        "physics": model.PhysicsConfig,
        "dynamics": model.DynamicsConfig,
        "vehicle_state": model.VehicleStateConfig,
    }
    schema = {table: set(rules) for table, rules in tables(Path()).items()}
    assert set(model.ROLES) == schema.pop("can.signals")
    schema["can"] |= {
        "signals",
        "options",
        "buses",
        "output",
    }  # tables of their own: docs/tutorial/fitting.md
    schema["vehicle"].add("teeth_by_wheel")  # the table form of teeth_per_rev
    assert {name: {f.name for f in dataclasses.fields(record)} for name, record in records.items()} == schema


def test_defaults_pass_their_own_rules() -> None:
    """What the model takes by default would be accepted from a file."""
    rules = tables(Path())
    for name, record in (
        ("filter", model.FilterConfig()),
        ("monitor", model.MonitorConfig()),
        ("alarms", model.AlarmsConfig()),
        ("gnss", model.GnssConfig()),
    ):
        for key, rule in rules[name].items():
            value = getattr(record, key)
            assert value is None or value == rule.read(list(value) if isinstance(value, tuple) else value)


@pytest.mark.parametrize("name", RECORDINGS)
def test_recordings(recordings: Path, name: str) -> None:
    """The real drives' own files load, by folder and by file."""
    config = load_config(recordings / name)
    assert config == load_config(recordings / name / "vehicle.toml")
    wheels = 4 if name.startswith("rav4") else 2
    assert wheels == sum(role.startswith("wheel_") for role in config.can.signals)
    assert config.can.dbc == recordings / name / "bus.dbc"


@pytest.mark.parametrize(
    ("old", "new", "starts", "text"),
    [
        ("wheel_radius_m", "wheel_radious_m", "wheel_radi",
         "[vehicle] wheel_radious_m: unknown key; did you mean wheel_radius_m?"),
        ("0.316", "316", "wheel_radius_m",
         "[vehicle] wheel_radius_m: out of range, found 316; allowed: 0.15 to 0.7 m; "
         "did you mean 0.316 (m, not mm)?"),
        ("0.316", '"0.316"', "wheel_radius_m",
         '[vehicle] wheel_radius_m: not a number, found "0.316"; allowed: 0.15 to 0.7 m; '
         "did you mean 0.316 without quotes?"),
        ("0.316", "true", "wheel_radius_m",
         "[vehicle] wheel_radius_m: not a number, found true; allowed: 0.15 to 0.7 m"),
        ("0.316", "nan", "wheel_radius_m",
         "[vehicle] wheel_radius_m: not a finite number, found nan; allowed: 0.15 to 0.7 m"),
        ("0.316", "[0.3, 0.3]", "wheel_radius_m",
         "[vehicle] wheel_radius_m: not a number, found an array; allowed: 0.15 to 0.7 m, "
         "or { fl = , fr = , rl = , rr = }"),
        ("1.52", "152", "track_rear_m",
         "[vehicle] track_rear_m: out of range, found 152; allowed: 0.8 to 3 m; "
         "did you mean 1.52 (m, not cm)?"),
        ("2.63", "inf", "wheelbase_m",
         "[vehicle] wheelbase_m: not a finite number, found inf; allowed: 1 to 8 m"),
        ('"front"', '"frnt"', "driven_axle",
         '[vehicle] driven_axle: not one of the choices, found "frnt"; allowed: front | rear | all; '
         "did you mean front?"),
        ("= 48", "= 0", "teeth_per_rev",
         "[vehicle] teeth_per_rev: out of range, found 0; allowed: above 0 and below 100000000"),
        ('"socketcan"', "1", "interface", "[can] interface: not a text, found 1; allowed: a text in quotes"),
        ('"bus.dbc"', '"buss.dbc"', "dbc", None),
        ('"WHEELS.CNT_FL"', '"CNT_FL"', "wheel_count_fl",
         "[can.signals] wheel_count_fl: not a signal's name, found \"CNT_FL\"; "
         "allowed: 'Message.Signal' as in the DBC"),
        ('"WHEELS.CNT_FL"', '"A.B.C"', "wheel_count_fl",
         "[can.signals] wheel_count_fl: not a signal's name, found \"A.B.C\"; "
         "allowed: 'Message.Signal' as in the DBC"),
        ('"WHEELS.CNT_FR"', '"WHEELS.CNT_FL"', "wheel_count_fr",
         '[can.signals] wheel_count_fr: is the signal of wheel_count_fl already, found "WHEELS.CNT_FL"'),
        ("yaw_rate", "yawrate", "yawrate", "[can.signals] yawrate: unknown role; did you mean yaw_rate?"),
        ("115200", "115200.5", "baud",
         "[gnss] baud: not a whole number, found 115200.5; allowed: 300 to 4000000"),
        ("antenna_left_m = 0.0", "antenna_left_m = -740", "antenna_left_m",
         "[gnss] antenna_left_m: out of range, found -740; allowed: -3 to 3 m; "
         "did you mean -0.74 (m, not mm)?"),
        ("[gnss]", "[gps]", "[gps]", None),
        ("baud", "baudrate", "baudrate", "[gnss] baudrate: unknown key; did you mean baud?"),
    ],
)  # fmt: skip
def test_one_mistake_is_one_line(make: Make, old: str, new: str, starts: str, text: str | None) -> None:
    """One mistake is one problem, at its line, with what was found and what is allowed."""
    path = make((old, new))
    problem, *others = problems_of(path)
    assert others == []
    assert line_number(path, starts) == problem.line
    if text is not None:
        assert f"{path}:{problem.line}: {text}" == problem.text


@pytest.mark.parametrize(
    ("extra", "text"),
    [
        ("[filter]\nrate_hz = 0.5", "[filter] rate_hz: out of range, found 0.5; allowed: 1 to 100 Hz"),
        ("[filter]\nrate_hz = 101", "[filter] rate_hz: out of range, found 101; allowed: 1 to 100 Hz"),
        ("[filter]\nparticles = 1e3.0", None),
        ('[filter]\nmethod = "mpf_pn"',
         '[filter] method: not one of the choices, found "mpf_pn"; '
         "allowed: aug-ekf | aug-pf | aug-ukf | gaussian-sum | mpf-mn | mpf-pn | mpf-pn-niw | "
         "mpf-pn-paper | mpf-rb; "
         "did you mean mpf-pn?"),
        ('[filter]\nmeasurements = ["gyro"]',
         '[filter] measurements: not one of the texts that may stand here, found "gyro"; '
         "allowed: a list of up to 5 texts of position speed course yaw_rate steering"),
        ("[filter]\nwindow_s = -1", "[filter] window_s: out of range, found -1; allowed: 2 to 86400 s"),
        ("[monitor]\nraise_probability = 1.0",
         "[monitor] raise_probability: out of range, found 1.0; allowed: above 0 and below 1"),
        ("[monitor]\nraise_probability = 99",
         "[monitor] raise_probability: out of range, found 99; allowed: above 0 and below 1; "
         "did you mean 0.99 (a share, not per cent)?"),
        ("[monitor]\nclear_probability = 0.995",
         "[monitor] clear_probability: alarms would flicker, found clear 0.995, raise 0.99; "
         "allowed: clear_probability below raise_probability"),
        ("[alarms]\nstatus_id = 0x800",
         "[alarms] status_id: out of range of 11-bit identifiers, found 0x800; "
         "allowed: 0x0 to 0x7FF, or extended_ids = true"),
        ("[alarms]\nstatus_id = 0x6F1",
         "[alarms] status_id: status_id and alarm_id are the same, found 0x6F1"),
        ("[alarms]\ncan = 1", "[alarms] can: not a flag, found 1; allowed: true or false"),
        ("[status]\nmode = 660",
         "[status] mode: out of range, found 660; allowed: 0o0 to 0o777; did you mean 0o660?"),
        ("[status]\nsocket = '/" + "s" * 107 + "'",
         "[status] socket: too long for a socket, found 108 bytes; allowed: at most 107 bytes"),
        ('[state]\nfile = "a\\u0000b"', None),
        ('[state]\nfile = "/srv/\\u001b[2J.json"',
         '[state] file: it holds control characters, found "/srv/\\u001b[2J.json"; '
         "allowed: a path in quotes, or '' for none"),
        ('[status]\nsocket = "/srv/\\u202Egol.json"', None),
        ('[state]\ninterval_s = "60"',
         '[state] interval_s: not a number, found "60"; allowed: 1 to 86400 s; '
         "did you mean 60 without quotes?"),
    ],
)  # fmt: skip
def test_mistakes_in_own_tables(make: Make, extra: str, text: str | None) -> None:
    """The tables beyond the contract are checked in the same way."""
    path = make(text=f"{GOOD_TOML}{extra}\n")
    (problem,) = problems_of(path)
    assert len((GOOD_TOML + extra).splitlines()) == problem.line
    if text is not None:
        assert f"{path}:{problem.line}: {text}" == problem.text


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[vehicle]", '[vehicle]\nname = "a\\nb"'),
        ('channel = "can0"', 'channel = "can0\\u001b[2J"'),
        ("WHEELS.CNT_FL", "WHEELS.CNT\\u009B_FL"),
        ('device = "/dev/ttyACM0"', 'device = "/dev/tty\\u001b[2J"'),
        ('device = "/dev/ttyACM0"', 'source = "serial:/dev/tty\\u001b[2J"'),
    ],
)
def test_no_text_steers_a_terminal(make: Make, old: str, new: str) -> None:
    """A name or a path with a control character is a problem, which shows it as TOML writes it."""
    assert GOOD_TOML.count(old) == 1
    problem = problems_of(make(text=GOOD_TOML.replace(old, new)))[0]
    assert problem.text.isprintable() and "\\" in problem.text


@pytest.mark.parametrize("table", ["can", "buses", "can.output"])
def test_a_dbc_whose_name_is_too_long_is_one_line(make: Make, table: str) -> None:
    """A path that the file system refuses, in any place where a DBC is named, is a problem of one line."""
    name = "9" * 400 + ".dbc"
    extra = {
        "buses": f'[can.buses]\nfront = {{ channel = "can1", dbc = "{name}" }}\n',
        "can.output": f'[[can.output]]\nmessage = "ESP"\ndbc = "{name}"\nsignals = {{ YAW = 0 }}\n',
    }
    if table == "can":
        (problem,) = problems_of(make(('dbc = "bus.dbc"', f'dbc = "{name}"')))
        assert "File name too long" in problem.text
    else:
        problems = problems_of(make(text=f"{GOOD_TOML}{extra[table]}"))
        assert any("dbc: no such file" in problem.text for problem in problems)


def test_all_problems_at_once(make: Make) -> None:
    """Mistakes in several tables are all said, in the order of their lines."""
    path = make(
        ("wheel_radius_m", "wheel_radious_m"),
        ("2.63", "263"),
        ("wheel_count_rr", "wheel_cuont_rr"),
        ("[gnss]", "[gnns]"),
    )
    found = [(problem.line, problem.suggestion) for problem in problems_of(path)]
    assert found == [
        (2, "wheel_radius_m"),
        (5, "2.63 (m, not cm)"),
        (line_number(path, "wheel_cuont_rr"), "wheel_count_rr"),
        (line_number(path, "[gnns]"), "[gnss]"),
    ]


@pytest.mark.parametrize(
    ("radius", "expected"),
    [
        ("{ fl = 0.31, fr = 0.32, rl = 0.33, rr = 0.34 }", (0.31, 0.32, 0.33, 0.34)),
        ("0.3", (0.3, 0.3, 0.3, 0.3)),
    ],
)
def test_radius_forms(make: Make, radius: str, expected: tuple[float, ...]) -> None:
    """The radius is one number or a table by wheels."""
    assert expected == load_config(make(("0.316", radius))).vehicle.wheel_radius_m


def test_radius_table_with_mistakes(make: Make) -> None:
    """Wheels that are missing, misspelt or out of range are each said at their own line."""
    path = make(
        ("wheel_radius_m = 0.316\n", ""),
        ("[can]", "[vehicle.wheel_radius_m]\nfl = 0.3\nrl = 3\nxx = 0.3\n[can]"),
    )
    found = {(problem.line, problem.key, problem.what) for problem in problems_of(path)}
    first = line_number(path, "[vehicle.wheel_radius_m]")
    assert found == {
        (first, "[vehicle] wheel_radius_m", "no radius of fr rr"),
        (first + 2, "[vehicle] wheel_radius_m.rl", "out of range"),
        (first + 3, "[vehicle] wheel_radius_m.xx", "no such wheel"),
    }


REAR_ONLY = (
    ('wheel_count_fl = "WHEELS.CNT_FL"\n', ""),
    ('wheel_count_fr = "WHEELS.CNT_FR"\n', ""),
)


def test_rear_pair_needs_neither_front_radii_nor_wheelbase_nor_both_tracks(make: Make) -> None:
    """With the rear pair alone, the rear radii and one track are enough."""
    vehicle = load_config(
        make(
            *REAR_ONLY,
            ("0.316", "{ rl = 0.31, rr = 0.33 }"),
            ("wheelbase_m = 2.63\n", ""),
            ("track_front_m = 1.53\n", ""),
        )
    ).vehicle
    assert pytest.approx((0.32, 0.32, 0.31, 0.33)) == vehicle.wheel_radius_m
    assert vehicle.track_front_m == vehicle.track_rear_m == 1.52


def test_rear_radii_alone_are_too_few_for_four_wheels(make: Make) -> None:
    """A wheel that has a signal needs a radius."""
    (problem,) = problems_of(make(("0.316", "{ rl = 0.31, rr = 0.33 }")))
    assert problem.what == "no radius of fl fr"


def test_track_front_alone(make: Make) -> None:
    """The rear track is that of the front where it is left out."""
    assert load_config(make(("track_rear_m = 1.52\n", ""))).vehicle.track_rear_m == 1.53


@pytest.mark.parametrize(
    ("edits", "key", "what"),
    [
        (
            [("track_rear_m = 1.52\n", ""), ("track_front_m = 1.53\n", "")],
            "[vehicle] track_rear_m",
            "missing",
        ),
        ([("wheel_radius_m = 0.316\n", "")], "[vehicle] wheel_radius_m", "missing"),
        (
            [("wheelbase_m = 2.63\n", "")],
            "[vehicle] wheelbase_m",
            "missing, and the front wheels are monitored",
        ),
        (
            [*REAR_ONLY, ("wheelbase_m = 2.63\n", ""), ("yaw_rate", "steering_wheel_angle")],
            "[vehicle] wheelbase_m",
            "missing, and the steering wheel's angle is used",
        ),
        ([('wheel_count_fr = "WHEELS.CNT_FR"\n', "")], "[can.signals] wheel_count_fr", "missing"),
        ([('wheel_count_rr = "WHEELS.CNT_RR"\n', "")], "[can.signals] wheel_count_rr", "missing"),
    ],
)
def test_missing_keys(make: Make, edits: list[tuple[str, str]], key: str, what: str) -> None:
    """What is needed and missing is said at the line of its table."""
    path = make(*edits)
    (problem,) = problems_of(path)
    assert (problem.key, problem.what) == (key, what)
    assert line_number(path, key.split()[0]) == problem.line


def test_front_pair_alone(make: Make) -> None:
    """The front wheels alone are too few: both rear ones are missing."""
    path = make(('wheel_count_rl = "WHEELS.CNT_RL"\n', ""), ('wheel_count_rr = "WHEELS.CNT_RR"\n', ""))
    keys = [problem.key for problem in problems_of(path)]
    assert keys == ["[can.signals] wheel_count_rl", "[can.signals] wheel_count_rr"]


def test_count_and_speed_of_one_wheel(make: Make) -> None:
    """A wheel has either a counter or a speed; different wheels may differ."""
    mixed = ('wheel_count_rr = "WHEELS.CNT_RR"', 'wheel_speed_rr = "SPEEDS.V_RR"')
    assert load_config(make(mixed)).can.signals["wheel_speed_rr"] == "SPEEDS.V_RR"
    both = ("yaw_rate", 'wheel_speed_rr = "SPEEDS.V_RR"\nyaw_rate')
    (problem,) = problems_of(make(both))
    assert (problem.key, problem.what) == (
        "[can.signals] wheel_speed_rr",
        "the wheel has wheel_count_rr already",
    )


def test_keys_in_the_wrong_place(make: Make) -> None:
    """A key in another's table, or before any table, is told where it belongs."""
    path = make(
        ("track_rear_m = 1.52\n", ""),
        ("[vehicle]\n", "track_rear_m = 1.52\n[vehicle]\nbaud = 9600\n"),
        ("baud = 115200\n", ""),
    )
    found = [(problem.line, problem.suggestion) for problem in problems_of(path)]
    assert found == [(1, "[vehicle] track_rear_m"), (3, "[gnss] baud")]


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("vehicle = 3", 1, "must be a table"),
        ("[can]\nsignals = 3", 2, "must be a table"),
        ("[[vehicle]]\nx = 1", 1, "must be a table"),
        ("\n['a\tb']", 2, "unknown table"),
        ("x = 1", 1, "unknown key"),
    ],
)
def test_odd_shapes(tmp_path: Path, text: str, line: int, what: str) -> None:
    """Tables that are none and keys nobody knows are problems like any other."""
    path = tmp_path / "v.toml"
    path.write_text(text)
    assert (line, what) in [(problem.line, problem.what) for problem in problems_of(path)]


def test_dbc_beside(make: Make) -> None:
    """A folder's bus.dbc is taken where the file names none, and missed where there is none."""
    path = make(('dbc = "bus.dbc"\n', ""))
    assert path.parent / "bus.dbc" == load_config(path).can.dbc
    (path.parent / "bus.dbc").unlink()
    (problem,) = problems_of(path)
    assert (problem.key, problem.what) == ("[can] dbc", "missing")


def test_dbc_override(make: Make, tmp_path: Path) -> None:
    """An override takes the place of the file's DBC, even of one that is missing; and must exist itself."""
    path = make(('"bus.dbc"', '"gone.dbc"'))
    other = tmp_path / "other.dbc"
    other.write_text("")
    assert other == load_config(path, other).can.dbc
    (problem,) = problems_of(path, tmp_path / "nowhere.dbc")
    assert (problem.file, problem.what) == (str(tmp_path / "nowhere.dbc"), "no such DBC file")


JSONISH = st.recursive(
    st.one_of(
        st.booleans().map(lambda flag: str(flag).lower()),
        st.integers().map(str),
        st.floats().map(lambda x: repr(x) if x == x and abs(x) != float("inf") else "nan"),
        st.sampled_from(
            ['"x"', '""', '"A.B"', "1979-05-27", "07:32:00", "inf", "0x" + "F" * 5000, '"\\u0000"']
        ),
    ),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]")
        | st.lists(inner, max_size=3).map(
            lambda items: "{" + ", ".join(f"k{i} = {item}" for i, item in enumerate(items)) + "}"
        )
    ),
    max_leaves=5,
)
SCHEMA = tables(Path())
TABLE = st.sampled_from([*SCHEMA, "gps", "can.signal", "vehicle.wheel_radius_m", '"\\n"'])
KEY = st.sampled_from(
    [key for rules in SCHEMA.values() for key in rules] + ["fl", "rr", "signals", "x", '"\\u001b"']
)


@given(st.lists(st.tuples(TABLE, st.dictionaries(KEY, JSONISH, max_size=6)), max_size=6))
@settings(
    derandomize=True,
    deadline=None,
    max_examples=200,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_random_toml(tmp_path: Path, content: list[tuple[str, dict[str, str]]]) -> None:
    """Whatever values stand under whatever keys, only a configuration or its problems come out."""
    path = tmp_path / "random.toml"
    text = "".join(
        f"[{table}]\n" + "".join(f"{key} = {value}\n" for key, value in pairs.items())
        for table, pairs in content
    )
    path.write_text(text, encoding="utf-8")
    problems = problems_of(path)  # never complete: no table holds all the wheels and there is no DBC
    assert all(1 <= (problem.line or 1) <= text.count("\n") + 1 for problem in problems)


@given(st.integers(0, len(GOOD_TOML)), st.integers(0, 30), st.text(max_size=8))
@settings(
    derandomize=True,
    deadline=None,
    max_examples=300,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_damaged_file(make: Make, start: int, length: int, scrap: str) -> None:
    """A good file with a piece replaced by anything loads or is refused, line by line."""
    path = make()
    damaged = GOOD_TOML[:start] + scrap + GOOD_TOML[start + length :]
    path.write_bytes(damaged.encode("utf-8", "surrogatepass"))
    try:
        config = load_config(path)
    except ConfigProblems as error:
        assert all(line.startswith(str(path)) for line in str(error).splitlines())
    else:
        assert 0.15 <= min(config.vehicle.wheel_radius_m) <= max(config.vehicle.wheel_radius_m) <= 0.7
