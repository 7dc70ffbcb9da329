"""The report: who needs attention and why, and a page that is whole by itself."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from typing import Any

import pytest

from tpmsd.fleet.report import report_document, report_text
from tpmsd.fleet.report_html import report_page
from tpmsd.fleet.tables import COLUMNS

Row = dict[str, Any]


def row(table: str, **values: object) -> Row:
    """A row with every column of its table, None where nothing is said."""
    assert set(values) <= set(COLUMNS[table])
    return {**dict.fromkeys(COLUMNS[table]), **values}


@pytest.fixture
def tables() -> dict[str, list[Row]]:
    """Two cars: one with an alarm that stands, one that was cleared, a leak; one drive that failed."""
    drives = [
        row(
            "drives",
            key=f"k{n}",
            car=car,
            model="m <1>",
            path=f"/d/{n}",
            start=1.7e9 + 1e5 * n,
            status="done",
        )
        for n, car in enumerate(["van & co", "van & co", "van 2", "van 2"])
    ]
    drives.append(
        row("drives", key="bad", car="van 2", model="m <1>", path="/d/9", status="failed", reason="torn")
    )
    for one in drives:
        one["reason"] = one["reason"] or ""
    alarm = {"kind": "deflation", "reason": ""}
    return {
        "drives": drives,
        "wheels": [
            row("wheels", key=f"k{n}", car="van 2", wheel=wheel, deviation_mm=-0.5, std_mm=0.1)
            for n in (2, 3)
            for wheel in ("fl", "fr", "rl", "rr")
        ],
        "alarms": [
            row("alarms", key="k0", car="van & co", time=1.7e9, wheel="rl", state="raised", **alarm),
            row("alarms", key="k1", car="van & co", time=1.7e9 + 1e5, wheel="rl", state="raised", **alarm),
            row("alarms", key="k2", car="van 2", time=1.7e9 + 2e5, wheel="fr", state="raised", **alarm),
            row("alarms", key="k3", car="van 2", time=1.7e9 + 3e5, wheel="fr", state="cleared", **alarm),
        ],
        "findings": [
            row(
                "findings",
                level="car",
                model="m <1>",
                car="van 2",
                kind="leak",
                effect="slow_leak",
                parameter="rl",
            )
            | {"value": -0.05, "std": 0.01, "unit": "%/week", "p_value": 1e-6, "status": "finding"},
            row(
                "findings",
                level="model",
                model="m <1>",
                kind="effect",
                effect="gnss_latency",
                parameter="latency_s",
            )
            | {"value": 0.1, "std": 0.004, "unit": "s", "p_value": 1e-9, "status": "finding"},
            row("findings", level="drive", model="m <1>", car="van 2", key="k2", effect="gnss_latency"),
        ],
        "statistics": [],
    }


def test_attention_is_what_stands(tables: dict[str, list[Row]]) -> None:
    """An alarm that stands counts since it was raised first, a cleared one not; leaks and failures do."""
    attention = report_document(tables)["attention"]

    assert [
        ("now", "van & co", "deflation rear left", "2023-11-14 22:13"),
        ("soon", "van 2", "slow leak rear left: -0.05 ± 0.01 %/week of radius", None),
        ("look", "van 2", "/d/9: torn", None),
    ] == [(one["urgency"], one["car"], one["why"], one["since"]) for one in attention]


def test_models_have_their_findings(tables: dict[str, list[Row]]) -> None:
    """The engineer's part names the model's effects, and in how many drives and cars each was named."""
    (model,) = report_document(tables)["models"]

    assert (2, 5) == (model["cars"], model["drives"])
    assert ["gnss_latency"] == [one["effect"] for one in model["findings"]]
    assert [{"effect": "gnss_latency", "drives": 1, "cars": 1}] == model["named_in_drives"]
    assert "gnss_latency latency_s: +0.1 ± 0.004 s (p 1e-09)" in report_text(report_document(tables))


class Page(HTMLParser):
    """Tags and texts of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: list[str] = []
        self.rows = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = dict(attrs)
        self.rows += tag == "tr"
        self.links += [value for key in ("href", "src") if (value := told.get(key))]
        self.ids += [value for value in (told.get("id"),) if value]


def test_the_page_is_whole_by_itself(tables: dict[str, list[Row]]) -> None:
    """The page loads nothing from outside, its links lead to places in it, and names are escaped."""
    text = report_page(report_document(tables), tables)
    page = Page()
    page.feed(text)

    assert [] == re.findall(r"https?://", text)
    assert page.links
    assert set() == {link.removeprefix("#") for link in page.links} - set(page.ids)
    assert "van &amp; co" in text
    assert "m <1>" not in text
    assert 4 == text.count("<polyline")
    assert text.count("<tr>") == page.rows
