"""The report: who needs attention and why, and a page that is whole by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.offline.report.pages import Page
from tpmsd.interfaces.cli.fleet_pages import write_drive_pages
from tpmsd.offline.fleet.report import model_title, report_document, report_text
from tpmsd.offline.fleet.report_page import report_page
from tpmsd.offline.fleet.settings import FleetSettings
from tpmsd.offline.fleet.tables import COLUMNS
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive

Row = dict[str, Any]


def row(table: str, **values: object) -> Row:
    """A row with every column of its table, None where nothing is said."""
    assert set(values) <= set(COLUMNS[table])
    return {**dict.fromkeys(COLUMNS[table]), **values}


@pytest.fixture
def tables() -> dict[str, list[Row]]:
    """The tables of a small fleet."""
    return fleet_tables()


def fleet_tables() -> dict[str, list[Row]]:
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
        ("soon", "van 2", "slow leak rear left: -0.05 +- 0.01 %/week of radius", None),
        ("look", "van 2", "/d/9: torn", None),
    ] == [(one["urgency"], one["car"], one["why"], one["since"]) for one in attention]


def test_a_malfunction_has_its_reason_and_the_advice_for_it(tables: dict[str, list[Row]]) -> None:
    """An encoder that loses counts is named as that, and the ring is to be checked, not the receiver."""
    reason = "the encoder of wheel rl loses 0.20 % of its counts"
    alarm = {"kind": "malfunction", "reason": reason, "state": "raised"}
    tables["alarms"] = [row("alarms", key="k0", car="van & co", time=1.7e9, wheel="rl", **alarm)]
    (one,) = [one for one in report_document(tables)["attention"] if one["car"] == "van & co"]
    assert f"malfunction rear left: {reason}" == one["why"]
    assert one["what_to_do"].startswith("check this wheel's encoder ring")


def test_one_tyre_has_one_row(tables: dict[str, list[Row]]) -> None:
    """An alarm, a loss and a leak of one tyre are one row, as urgent as the worst of them."""
    leak = dict(tables["findings"][0])
    loss = leak | {
        "car": "van & co",
        "kind": "loss",
        "effect": "radius",
        "unit": "mm",
        "value": -2.0,
        "std": 0.2,
    }
    tables["findings"] += [leak | {"car": "van & co"}, loss]
    mine = [one for one in report_document(tables)["attention"] if one["car"] == "van & co"]
    (one,) = mine
    assert ("now", 3) == (one["urgency"], len(one["why"].split("; ")))
    assert "2023-11-14 22:13" == one["since"]


def test_names_need_confidence_and_models_are_readable(tables: dict[str, list[Row]]) -> None:
    """A finding of low confidence is not named; a derived name of a model is said in words."""
    weak = row("findings", level="drive", model="m <1>", car="van 2", key="k3", effect="road_grade")
    tables["findings"].append(weak | {"confidence": 0.31, "status": "finding"})
    (model,) = report_document(tables)["models"]
    assert ["gnss_latency"] == [one["effect"] for one in model["named_in_drives"]]
    assert "wheelbase 2.63 m, driven front (f1f6)" == model_title("2.63m-front-f1f6")
    assert "m <1>" == model_title("m <1>")


def test_models_have_their_findings(tables: dict[str, list[Row]]) -> None:
    """The engineer's part names the model's effects, and in how many drives and cars each was named."""
    (model,) = report_document(tables)["models"]

    assert (2, 5) == (model["cars"], model["drives"])
    assert ["gnss_latency"] == [one["effect"] for one in model["findings"]]
    assert [{"effect": "gnss_latency", "drives": 1, "cars": 1}] == model["named_in_drives"]
    assert "gnss_latency latency_s: +0.1 +- 0.004 s (p 1e-09)" in report_text(report_document(tables))


def test_reasons_are_words_and_drives_of_one_instant_do_not_mix(tables: dict[str, list[Row]]) -> None:
    """A kind is said without underscores; an alarm cleared on one drive stands on another at one instant."""
    for one in tables["drives"]:
        one["start"] = 1.7e9
    alarm = {"kind": "radius_deviation", "wheel": "rl", "reason": "", "car": "van & co"}
    tables["alarms"] = [
        row("alarms", key="k0", time=1.7e9 + 1.0, state="raised", **alarm),
        row("alarms", key="k0", time=1.7e9 + 9.0, state="cleared", **alarm),
        row("alarms", key="k1", time=1.7e9 + 5.0, state="raised", **alarm),
    ]
    differs = dict(tables["findings"][0]) | {"kind": "effect", "effect": "gnss_latency"}
    tables["findings"] = [differs | {"parameter": "latency_s", "unit": "s"}]
    whys = [one["why"] for one in report_document(tables)["attention"]]
    assert "radius deviation rear left" in whys
    assert "unlike its model: GNSS latency latency by -0.05 +- 0.01 s" in whys


def test_the_page_is_whole_by_itself(tables: dict[str, list[Row]]) -> None:
    """It loads nothing, its links lead to places in it, names are escaped, each car has its plot."""
    page = Page(report_page(report_document(tables), tables))

    assert [] == page.loaded
    assert {"car-van_20_2", "car-van_20__26__20_co"} == set(page.links)
    assert set(page.links) <= set(page.ids)
    assert {1} == set(page.ids.values())
    assert "m <1>: 5 drives of 2 cars" in page.text
    assert "GNSS latency|latency|0.1|0.09216 to 0.1078|s|1e-09|" in page.text
    (radii,) = page.data
    assert ["front left", "front right", "rear left", "rear right"] == [
        one["name"] for one in radii["curves"]
    ]
    assert -0.7 == pytest.approx(radii["curves"][0]["low"][-1])


@pytest.mark.parametrize(("apart_s", "title"), [(1e5, "Radii over the date"), (0.0, "Radii, drive by drive")])
def test_drives_of_one_instant_stand_side_by_side(
    tables: dict[str, list[Row]], apart_s: float, title: str
) -> None:
    """A simulator starts every drive at one instant: a date would put all their points onto one x."""
    for n, one in enumerate(tables["drives"]):
        one["start"], one["duration_s"] = 1.7e9 + apart_s * n, 600.0
    page = report_page(report_document(tables), tables)
    assert title in page
    assert ("some overlap in time" in page) == (apart_s == 0.0)
    assert [apart_s == 0.0] == [one["counts"] for one in Page(page).data], "marks at whole numbers"


def test_a_large_fleet_has_few_pictures(
    tables: dict[str, list[Row]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond a bound a car's plot is data alone; its table is there all the same."""
    monkeypatch.setattr("tpmsd.offline.fleet.report_page.SETTINGS", FleetSettings(max_pictures=0))
    page = Page(report_page(report_document(tables), tables))

    assert (0, 1) == (page.tags["svg"], len(page.data))
    assert "-0.50 ± 0.10|" in page.text


def test_a_drive_with_an_alarm_leads_to_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tables: dict[str, list[Row]]
) -> None:
    """A drive that can be read has a page that the report links; one that is gone is named."""
    spec = DriveSpec(route="oval", duration_s=40.0)
    folder = write_drive(tmp_path / "d", simulate_drive(spec))
    first, second = list(dict.fromkeys(row["key"] for row in tables["alarms"]))[:2]
    moved = [row | {"path": str(folder)} if row["key"] == first else row for row in tables["drives"]]
    links = write_drive_pages(tmp_path / "fleet.html", {**tables, "drives": moved})

    assert {first: f"fleet-drives/{first}.html"} == links
    assert "<title>" in (tmp_path / links[first]).read_text()
    assert "no page of this drive" in capsys.readouterr().err
    made = report_page(report_document(tables), tables, links)
    assert f'<a href="fleet-drives/{first}.html">' in made
    assert second not in links
