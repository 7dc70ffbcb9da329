"""What README and docs show is what the program takes: its configuration, its log lines, its JSON."""

from __future__ import annotations

import json
import re
from pathlib import Path

from tests.offline.report.drives import puncture
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import OPTIONAL_ROLES
from tpmsd.offline.report.replay_document import replay_document
from tpmsd.onboard.sources.gnss.nmea_sentence import decode_sentence

REPO = Path(__file__).resolve().parent.parent
README = (REPO / "README.md").read_text(encoding="utf-8")
FORMATS = (REPO / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
FITTING = (REPO / "docs" / "tutorial" / "fitting.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    """The text of the block in this language on the page about formats."""
    (text,) = re.findall(rf"```{language}\n(.*?)```", FORMATS, re.DOTALL)
    return str(text)


def configuration() -> str:
    """The complete vehicle.toml of docs/tutorial/fitting.md."""
    found = re.findall(r"```toml\n(.*?)```", FITTING, re.DOTALL)
    (text,) = [text for text in found if "wheel_radius_m" in text]
    return str(text)


def test_the_configuration_of_the_readme_is_right(tmp_path: Path) -> None:
    """The vehicle.toml shown there loads, with the values it shows."""
    file = tmp_path / "vehicle.toml"
    file.write_text(configuration(), encoding="utf-8")
    (tmp_path / "bus.dbc").touch()
    config = load_config(file)

    assert (0.316,) * 4 == config.vehicle.wheel_radius_m
    assert "WHEELS.CNT_RL" == config.can.signals["wheel_count_rl"]
    assert 0.4 == config.gnss.antenna_forward_m


def test_the_readme_names_every_optional_role() -> None:
    """A signal that tpmsd can use is named where one looks for it."""
    assert [] == [role for role in OPTIONAL_ROLES if role not in configuration()]


def test_the_sentence_of_the_readme_is_sound() -> None:
    """The NMEA line shown there has the right checksum."""
    (line,) = re.findall(r"\$GNRMC,\S+", FORMATS)
    reading = decode_sentence(line.encode())

    assert 52 + 30.12345 / 60 == reading.latitude_deg


def test_the_json_of_the_readme_has_the_keys_of_the_document() -> None:
    """Every key shown there is in the document that is written."""
    shown = json.loads(block("json"))
    document = replay_document(puncture().record().result(1.0))

    assert shown.keys() <= document.keys()
    assert shown["wheels"]["rl"].keys() <= document["wheels"]["rl"].keys()
    assert shown["alarms"][0].keys() <= document["alarms"][0].keys()


def test_the_readme_is_short() -> None:
    """At most 120 lines."""
    assert len(README.splitlines()) <= 120


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as the forges and mkdocs make them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_of_the_documents_lead_somewhere() -> None:
    """Every relative link names a file that exists and, with an anchor, a heading of it."""
    missing = []
    pages = [*REPO.glob("*.md"), *(REPO / "docs").rglob("*.md"), *(REPO / "bench").rglob("*.md")]
    for page in pages:
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            target, _, anchor = link.partition("#")
            if ":" in target:
                continue
            file = page.parent / target if target else page
            if not file.exists() or (anchor and anchor not in anchors(file.read_text(encoding="utf-8"))):
                missing.append(f"{page.relative_to(REPO)}: {link}")
    assert [] == missing
