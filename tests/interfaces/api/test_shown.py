"""How public objects show themselves: one line each, and cards that any notebook can hold."""

from __future__ import annotations

import dataclasses
from html.parser import HTMLParser
from typing import Any

import pytest

import tpmsd
from tpmsd.offline.report.card import MAX_ROWS, card

MAX_REPR_CHARS = 2_000


@pytest.fixture(scope="module")
def shown() -> dict[str, Any]:
    """A drive with a name that is no HTML, and everything that is made of it."""
    drive = dataclasses.replace(tpmsd.simulate(duration_s=120.0, seed=3), name='<b>it\'s & "mine"</b>')
    return {
        "Drive": drive,
        "Replay": tpmsd.replay(drive, table=True),
        "Diagnosis": tpmsd.diagnose(drive),
        "Calibration": tpmsd.calibrate(drive),
        "Discovery": tpmsd.discover(drive),
        "Fault": tpmsd.Fault("step", 2.0, wheel="rl"),
    }


def reached(root: Any) -> dict[str, Any]:
    """Path -> object of every object of the package that can be had from one by its fields and properties."""
    found: dict[str, Any] = {}
    known: set[int] = set()
    waiting = [("", root)]
    while waiting:
        path, one = waiting.pop()
        if id(one) in known or path.count(".") > 7:
            continue
        known.add(id(one))
        own = type(one).__module__.startswith("tpmsd")
        if own:
            found[path] = one
        if isinstance(one, dict):
            waiting += [(f"{path}[{key!r}]", value) for key, value in list(one.items())[:4]]
        elif isinstance(one, list | tuple) and not hasattr(one, "_fields"):
            waiting += [(f"{path}[{place}]", value) for place, value in enumerate(one[:3])]
        elif own:
            fields = dataclasses.fields(one) if dataclasses.is_dataclass(one) else ()
            names = [field.name for field in fields] + list(getattr(one, "_fields", ()))
            names += [name for name, value in vars(type(one)).items() if isinstance(value, property)]
            waiting += [(f"{path}.{name}", getattr(one, name)) for name in names if name[0] != "_"]
    return found


def test_every_public_class_is_shown(shown: dict[str, Any]) -> None:
    """The objects below are of all public classes."""
    classes = {name for name in tpmsd.__all__ if isinstance(getattr(tpmsd, name), type)}
    assert {name for name in classes if not issubclass(getattr(tpmsd, name), Exception)} == set(shown)


@pytest.mark.parametrize("name", ["Drive", "Replay", "Diagnosis", "Calibration", "Discovery", "Fault"])
def test_every_repr_is_short(name: str, shown: dict[str, Any]) -> None:
    """The `repr` of a public object is one line, and of all that can be had from it 2 kB at most."""
    text = repr(shown[name])
    assert text.startswith(f"{name}(")
    assert 1 == len(text.splitlines())
    assert len(text) <= 500
    objects = reached(shown[name])
    assert len(objects) >= (1 if name == "Fault" else 5)
    assert {} == {path: len(repr(one)) for path, one in objects.items() if len(repr(one)) > MAX_REPR_CHARS}


class Reader(HTMLParser):
    """Gathers what a card is made of."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.attributes: dict[str, str | None] = {}
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.open.append(tag)
        self.attributes.update(attrs)

    def handle_endtag(self, tag: str) -> None:
        assert tag == self.open.pop()

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("name", ["Drive", "Replay", "Diagnosis", "Calibration", "Discovery"])
def test_every_card_stands_alone(name: str, shown: dict[str, Any]) -> None:
    """A card is small sound HTML that escapes its texts, sets no colour and loads nothing."""
    made = shown[name]._repr_html_()
    reader = Reader()
    reader.feed(made)

    assert len(made) < 20_000
    assert [] == reader.open
    assert set(reader.tags) <= {"div", "p", "b", "table", "thead", "tbody", "tr", "th", "td"}
    assert set(reader.attributes) == {"class", "style"}
    style = reader.attributes["style"] or ""
    assert not any(word in style for word in ("color", "background", "url", "#"))
    assert name == "Discovery" or '<b>it\'s & "mine"</b>' in reader.text


def test_a_card_has_few_rows() -> None:
    """Of a long table a card shows the first rows and says how many are left."""
    made = card("long", (("n",), [(number,) for number in range(MAX_ROWS + 7)]))

    assert MAX_ROWS + 2 == made.count("<tr>")
    assert "<td>and 7 more</td>" in made
