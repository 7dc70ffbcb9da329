"""Real DBC files, and hostile ones: what can be used is, within bounds of time and memory."""

from __future__ import annotations

import importlib.util
import resource
import subprocess
import sys
from pathlib import Path

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.car.config.conftest import GOOD_DBC
from tpmsd.car.config.dbc import NotedDatabase, load_dbc
from tpmsd.car.config.dbc_text import DbcReader
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.car.config.units import canonical_unit

WHEELS = 'BO_ 176 WHEELS: 8 CAR\n SG_ A : 0|16@1+ (1,0) [0|65535] "" CAR\n'


def opendbc_files() -> list[Path]:
    spec = importlib.util.find_spec("opendbc")
    assert spec is not None and spec.origin is not None
    return sorted((Path(spec.origin).parent / "dbc").rglob("*.dbc"))


def test_every_dbc_of_opendbc() -> None:
    """Every file that holds a message loads; each of its messages is there, or noted as left out."""
    files = opendbc_files()
    assert len(files) > 50
    for file in files:
        begun = sum(
            line.lstrip().startswith("BO_ ") and " VECTOR__INDEPENDENT" not in line
            for line in file.read_text("utf-8", "replace").splitlines()
        )
        if not begun:
            with pytest.raises(ConfigProblems, match="holds no messages"):
                load_dbc(file)
            continue
        database = load_dbc(file)
        assert isinstance(database, NotedDatabase)
        left_out = sum("message" in note.what and "left out" in note.what for note in database.notes)
        assert len(database.messages) <= begun <= len(database.messages) + left_out, file.name


def test_the_same_as_cantools_where_cantools_reads_it() -> None:
    """Frames, bits, scales, units, choices and multiplexing are those that cantools finds."""
    compared = 0
    for file in opendbc_files()[::10]:
        try:
            theirs = cantools.database.load_file(file, strict=False)
        except Exception:
            continue
        if not theirs.messages:
            continue
        ours = {(m.frame_id, m.name): m for m in load_dbc(file).messages}
        for message in theirs.messages:
            mine = ours[message.frame_id, message.name]
            for signal in message.signals:
                found = mine.get_signal_by_name(signal.name)
                for key in ("start", "length", "byte_order", "is_signed", "scale", "offset", "is_float"):
                    assert getattr(signal, key) == getattr(found, key), (file.name, signal.name, key)
                assert (signal.multiplexer_ids, signal.multiplexer_signal) == (
                    found.multiplexer_ids,
                    found.multiplexer_signal,
                )
                assert {k: str(v) for k, v in (signal.choices or {}).items()} == (found.choices or {})
                compared += 1
    assert compared > 1000


@pytest.mark.parametrize(
    ("line", "note"),
    [
        (' SG_ L : 0|4000000000@1+ (1,0) [0|0] "" X', "4000000000 bits"),
        (' SG_ A : 8|8@1+ (1,0) [0|0] "" X', "stands twice"),
        (' SG_ B : 60|16@1+ (1,0) [0|0] "" X', "lies beyond the message's bytes"),
        (' SG_ B m0 : 8|8@1+ (1,0) [0|0] "" X', "multiplexer is not there"),
        (' SG_ B : 8|8@1+ (1,0 [0|0] "" X', "invalid syntax"),
        ("BO_ 403439865 LONG: 8 X", "taken as one of 29 bits"),
        ("BO_ 4294967295 LONG: 8 X", "more than 29 bits"),
        ('VAL_ 176 NOT_THERE 0 "off" ;', "a signal that is not there"),
        (f"BO_ {'9' * 5000} LONG: 8 X", "message left out: invalid syntax"),
        (f"BO_ 177 LONG: {'9' * 5000} X", "message left out: invalid syntax"),
        (f' SG_ B m{"9" * 5000} : 8|8@1+ (1,0) [0|0] "" X', "invalid syntax"),
        (f' SG_ B : {"9" * 5000}|8@1+ (1,0) [0|0] "" X', "invalid syntax"),
    ],
)
def test_what_is_wrong_is_noted_and_the_rest_is_used(tmp_path: Path, line: str, note: str) -> None:
    """One bad statement costs itself alone, and is noted with its line."""
    file = tmp_path / "bus.dbc"
    file.write_text(f"{WHEELS}{line}\n\nBO_ 177 NEXT: 8 X\n")
    database = load_dbc(file)

    assert isinstance(database, NotedDatabase)
    assert [3] == [found.line for found in database.notes]
    assert note in database.notes[0].what
    assert {"WHEELS", "NEXT"} <= {message.name for message in database.messages}


def multiplexed() -> str:
    """Multiplexers in a tree of four storeys, in a chain, and with many values for each of many signals."""
    sg = ' SG_ S{} {} : {}|8@1+ (1,0) [0|0] "" X\n'
    tree = "BO_ 177 TREE: 64 C\n" + "".join(sg.format(k, "m0M" if k else "M", 8 * k) for k in range(4))
    tree += "".join(f"SG_MUL_VAL_ 177 S{k} S{k - 1} 0-255;\n" for k in range(1, 4))
    chain = "BO_ 178 CHAIN: 64 C\n" + sg.format(0, "M", 0)
    chain += "".join(sg.format(k, "m0M", k % 60) for k in range(1, 2_000))
    chain += "".join(f"SG_MUL_VAL_ 178 S{k} S{k - 1} 0-0;\n" for k in range(1, 2_000))
    many = 'BO_ 179 MANY: 64 C\n SG_ S0 M : 0|16@1+ (1,0) [0|0] "" X\n'
    many += "".join(sg.format(k, "m0", 32) for k in range(1, 2_000))
    many += "".join(f"SG_MUL_VAL_ 179 S{k} S0 0-4000;\n" for k in range(1, 2_000))
    return tree + chain + many


def repetitions() -> list[str]:
    """Statements that end in a megabyte of the same."""
    digits, blanks = "1" * 900_000, " " * 900_000
    return [
        *(f" SG_ B : 0|8@1+ ({digits}", f" SG_ B : 0|8@1+ (1,{digits}", f" SG_ B m{digits}", f"BO_ {digits}"),
        *(
            f" SG_ B{blanks}x",
            f"VAL_ 176 A {digits}",
            f"VAL_ 176 A 1{blanks}",
            f"SG_MUL_VAL_ 176 A A {digits}",
        ),
        *(f'BA_ "GenMsgCycleTime" BO_ {digits}', f"SIG_VALTYPE_ {digits}", 'VAL_ 176 A 1 "' + "\\" * 900_001),
    ]


HOSTILE = {
    "multiplexer": WHEELS
    + 'BO_ 177 M: 8 C\n SG_ S M : 0|32@1+ (1,0) [0|0] "" X\n SG_ A m0 : 32|8@1+ (1,0) [0|0] "" X\n'
    + "SG_MUL_VAL_ 177 A S 0-100000000;\n",
    "length": WHEELS + 'BO_ 178 L: 8 C\n SG_ A : 0|4000000000@1+ (1,0) [0|0] "" X\n',
    "comment": WHEELS + 'CM_ BO_ 176 "' + "x" * 60_000_000 + '";\n',
    "lines": WHEELS + 'CM_ BO_ 176 "' + ("x" * 60 + "\n") * 1_000_000 + '";\n',
    "layouts": WHEELS + multiplexed(),
    "repetitions": WHEELS + "\n".join(repetitions()),
    "messages": WHEELS + "".join(f"BO_ {1000 + i} N{i}: 8 CAR\n" for i in range(100_000)),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_files_stay_within_bounds(tmp_path: Path, kind: str) -> None:
    """A file made to eat memory is read, or refused in one line, within 10 s and 300 MB."""
    file = tmp_path / "bus.dbc"
    file.write_text(HOSTILE[kind])
    code = (
        "import re, sys; from pathlib import Path; from tpmsd.car.config.dbc import load_dbc\n"
        "from tpmsd.car.config.problems import ConfigProblems\n"
        "try: load_dbc(Path(sys.argv[1]))\n"
        "except ConfigProblems as error: assert '\\n' not in str(error)\n"
        # Of this process's own memory: what getrusage tells counts the tests' process before the exec, too.
        "print(int(re.search(r'VmHWM:\\s+(\\d+)', Path('/proc/self/status').read_text())[1]) // 1024)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(file)],
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (10, 10)),
        check=True,
    )
    assert int(done.stdout) < 300


def test_multiplexers_below_one_another_are_read_up_to_the_bound() -> None:
    """A chain is read down to the sixteenth signal; of a tree with 256 values each the root is left."""
    reader = DbcReader()
    reader.read(line.encode() for line in (WHEELS + multiplexed()).splitlines())
    _, tree, chain, many = reader.messages()
    assert [["S0"], ["S0"]] == [[signal.name for signal in message.signals] for message in (tree, many)]
    assert [f"S{k}" for k in range(17)] == sorted((s.name for s in chain.signals), key=lambda n: int(n[1:]))
    notes = " ".join(note.what for note in reader.notes)
    assert "TREE: multiplexed signals left out: too many layouts" in notes
    assert "S17 left out: more than 16 multiplexers in a chain" in notes


def test_no_name_steers_a_terminal(tmp_path: Path) -> None:
    """Control characters and turned writing in names, units and notes become a sign that is neither."""
    file, steers = tmp_path / "bus.dbc", "\x1b\x07\u202e\x9b"
    text = WHEELS.replace(" A ", f" A{steers} ").replace('""', f'"{steers}"')
    file.write_text(f"{text} SG_ X{steers} : 0|0@1+ (1,0) [0|1]\n")
    database = load_dbc(file)
    assert isinstance(database, NotedDatabase)
    (signal,) = database.messages[0].signals
    (note,) = database.notes
    mark = "\N{REPLACEMENT CHARACTER}"
    assert (f"A{4 * mark}", 4 * mark) == (signal.name, signal.unit)
    assert f"signal WHEELS.X{4 * mark} left out: 0 bits at 0" == note.what


@given(st.integers(0, len(GOOD_DBC)), st.integers(0, 40), st.text(alphabet='0189 -"(|@,:ax;M.\n', max_size=8))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_no_damage_raises(start: int, length: int, scrap: str) -> None:
    """A DBC with a piece replaced is read as far as it goes; nothing in it raises."""
    reader = DbcReader()
    reader.read((GOOD_DBC[:start] + scrap + GOOD_DBC[start + length :]).encode().splitlines(keepends=True))
    assert len(reader.messages()) <= 4


@pytest.mark.parametrize(
    ("spelling", "unit"),
    [
        ("Unit_KiloMeterPerHour", "km/h"),
        ("Unit_MeterPerSeconSquar", "m/s2"),
        ("Unit_DegreOfArcPerSecon", "deg/s"),
        ("Unit_MinutInver", "rpm"),
        ("Unit_Bar", "bar"),
        ("Unit_NewtoMeter", "Nm"),
        ("Unit_DegreCelsi", "degC"),
        ("degrees/second", "deg/s"),
        ("km^h", "km/h"),
        ("kn", "knots"),
    ],
)
def test_units_of_real_files(spelling: str, unit: str) -> None:
    """The spellings that makers' own tools write are known."""
    assert unit == canonical_unit(spelling)
