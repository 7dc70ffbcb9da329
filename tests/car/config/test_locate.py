"""The line of every key of a TOML file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.locate import KeyPath, PathStep, line_of, locate

TRICKY = '''\
# [vehicle] is not here
title = "[fake]" # nor = here
[vehicle]  # comment
text = """
wheel_radius_m = 1
[can]
quote \\""" and "two" ""\\
"""
"quoted key" . 'inner' = { a = 1, b = [1,
  2, { c = "}" }], d = 'x' }
literal = \'\'\'
[no]
\'\'\'
array = [ # ] comment
  "a, ]",
  [1, 2],
]
time = 1979-05-27 07:32:00
[can.signals]
wheel_count_fl = "A.B"
[[list]]
x = 1
[[list]]
x = 2
[list.sub]
y = 3
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("title",), 2),
        (("vehicle",), 3),
        (("vehicle", "text"), 4),
        (("vehicle", "quoted key", "inner"), 9),
        (("vehicle", "quoted key", "inner", "a"), 9),
        (("vehicle", "quoted key", "inner", "b", 1), 10),
        (("vehicle", "quoted key", "inner", "b", 2, "c"), 10),
        (("vehicle", "quoted key", "inner", "d"), 10),
        (("vehicle", "literal"), 11),
        (("vehicle", "array", 0), 15),
        (("vehicle", "array", 1, 1), 16),
        (("vehicle", "time"), 18),
        (("can", "signals"), 19),
        (("can", "signals", "wheel_count_fl"), 20),
        (("list", 0, "x"), 22),
        (("list", 1, "x"), 24),
        (("list", 1, "sub", "y"), 26),
    ],
)
def test_tricky_file(path: KeyPath, line: int) -> None:
    """Comments, strings, arrays and inline tables over several lines do not lead the count astray."""
    assert line == locate(TRICKY)[path]


def test_finds_every_key_and_nothing_else() -> None:
    """The located paths are those of the parsed data."""
    assert _paths(tomllib.loads(TRICKY)) == set(locate(TRICKY))


def test_line_of_missing_key_is_that_of_its_table() -> None:
    """A key that is not there is looked for where its table is; a table that is not there has no line."""
    lines = locate("\n[a]\nx = 1\n")
    assert [2, 3, None] == [
        line_of(lines, ("a", "y")),
        line_of(lines, ("a", "x")),
        line_of(lines, ("b", "y")),
    ]


def test_windows_line_ends() -> None:
    """Lines that end in CR LF count once."""
    assert {("a",): 1, ("b",): 3} == locate("a = 1\r\n\r\nb = 2\r\n")


def test_stops_at_what_is_no_toml() -> None:
    """What stands before the nonsense is located all the same."""
    assert {("a",): 1} == locate("a = 1\n= 2\nb = 3\n")


def test_deep_nesting_is_no_crash() -> None:
    """Brackets nested beyond any stack leave the lines found so far."""
    assert locate("a = 1\nb = " + "[" * 100_000)[("a",)] == 1


@dataclass
class _Writer:
    """Writes a random document and notes on which line each key went."""

    text: str = ""
    lines: dict[KeyPath, int] = field(default_factory=dict)

    @property
    def line(self) -> int:
        return self.text.count("\n") + 1


KEYS = st.one_of(
    st.from_regex(r"[A-Za-z0-9_-]{1,6}", fullmatch=True),
    st.sampled_from(['"a b"', "'c.d'", '"=["', '"\\u0041"', '"#"', "'\"'", '""']),
)
PLAIN = [
    "1",
    "-0.5e3",
    "true",
    "nan",
    '"x"',
    '"]"',
    '"\\""',
    "'}'",
    "''",
    '""',
    "1979-05-27T07:32:00Z",
    "0x1F",
]
LONG = ['"""\n[x]\ny = 1\n"""', "'''\n'''", '"""a""""', '""""b"""', '"""\\""""""', "'''c''''", '"#"']
SCALARS = st.sampled_from(PLAIN + LONG)
BREAKS = st.sampled_from(["", " ", "\n", " # ], }\n  ", "\n\n"])
VALUES = st.recursive(
    SCALARS.map(lambda text: ("scalar", text)),
    lambda inner: st.one_of(
        st.tuples(st.just("array"), st.lists(st.tuples(BREAKS, inner, BREAKS), max_size=3)),
        st.tuples(
            st.just("table"), st.lists(st.tuples(KEYS, inner), max_size=3, unique_by=lambda kv: _name(kv[0]))
        ),
    ),
    max_leaves=6,
)
PAIRS = st.lists(st.tuples(KEYS, VALUES, st.sampled_from(["\n", "\n\n", " # c = 1\n"])), max_size=4)
TABLES = st.lists(st.tuples(KEYS, PAIRS), max_size=4, unique_by=lambda table: _name(table[0]))


def _name(key: str) -> str:
    return str(next(iter(tomllib.loads(f"{key} = 1"))))


def _write_value(out: _Writer, path: KeyPath, value: tuple[str, Any]) -> None:
    kind, content = value
    if kind == "scalar":
        out.text += content
    elif kind == "array":
        out.text += "["
        for index, (before, inner, after) in enumerate(content):
            out.text += before
            out.lines[(*path, index)] = out.line
            _write_value(out, (*path, index), inner)
            out.text += after + ","
        out.text += "]"
    else:
        out.text += "{"
        for index, (key, inner) in enumerate(content):
            out.text += ", " if index else ""
            out.lines[(*path, _name(key))] = out.line
            out.text += f"{key} = "
            _write_value(out, (*path, _name(key)), inner)
        out.text += "}"


@given(TABLES)
@settings(derandomize=True, deadline=None, max_examples=300)
def test_random_documents(tables: list[tuple[str, list[tuple[str, tuple[str, Any], str]]]]) -> None:
    """Each key of any document is found on the line on which it was written."""
    out = _Writer()
    for table, pairs in tables:
        out.lines[(_name(table),)] = out.line
        out.text += f"[{table}]\n"
        seen = set()
        for key, value, end in pairs:
            if _name(key) in seen:
                continue
            seen.add(_name(key))
            path = (_name(table), _name(key))
            out.lines[path] = out.line
            out.text += f"{key}={' '}"
            _write_value(out, path, value)
            out.text += end
    tomllib.loads(out.text)  # the writer writes TOML
    assert out.lines == locate(out.text)


@given(st.text(alphabet="ab.=[]{}\"'#,\n\\ 1", max_size=60))
@settings(derandomize=True, deadline=None, max_examples=500)
def test_any_text(text: str) -> None:
    """No text makes the scanner fail, and where the text is TOML it finds what the parser finds."""
    lines = locate(text)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    assert _paths(data) == set(lines)


def _paths(value: object, path: tuple[PathStep, ...] = ()) -> set[KeyPath]:
    found: set[KeyPath] = {path} if path else set()
    inner: list[tuple[PathStep, object]] = []
    if isinstance(value, dict):
        inner = list(value.items())
    elif isinstance(value, list):
        inner = list(enumerate(value))
    for key, content in inner:
        found |= _paths(content, (*path, key))
    return found
