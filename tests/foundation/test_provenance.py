"""Every document says its schema, its program and its input."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tpmsd import __version__
from tpmsd.foundation.provenance import commit, content_hash, provenance

REPO = Path(__file__).resolve().parents[2]


def test_the_hash_is_of_content_and_not_of_place(tmp_path: Path) -> None:
    """A copied drive hashes alike; another byte, another name or another file does not."""
    a, b = tmp_path / "a", tmp_path / "b"
    for folder in (a, b):
        folder.mkdir()
        (folder / "can.log").write_bytes(b"frames")
        (folder / "gnss.nmea").write_bytes(b"fixes")
    first = content_hash([a])

    assert first == content_hash([b])
    (b / "can.log").write_bytes(b"framez")
    assert first != content_hash([b])
    (b / "can.log").write_bytes(b"frames")
    (b / "gnss.nmea").rename(b / "gnss.nme")
    assert first != content_hash([b])
    assert content_hash([a / "can.log", a / "gnss.nmea"]) != content_hash([a / "gnss.nmea", a / "can.log"])


def test_the_configuration_of_a_drive_folder_is_its_vehicle_file(tmp_path: Path) -> None:
    """The document names the file that was read."""
    (tmp_path / "vehicle.toml").write_text("[vehicle]")
    document = provenance("tpmsd.replay/2", [tmp_path], tmp_path)

    assert ("tpmsd.replay/2", __version__) == (document["schema"], document["program"]["version"])
    assert [str(tmp_path)] == document["input"]["paths"]
    assert str(tmp_path / "vehicle.toml") == document["input"]["configuration"]
    assert document["input"]["hash"].startswith("sha256:")
    assert content_hash([tmp_path / "vehicle.toml"]) == document["input"]["configuration_hash"]


def test_the_commit_is_that_of_the_checkout() -> None:
    """What git says, where there is a checkout; else nothing."""
    said = subprocess.run(
        ["git", "-C", str(REPO), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    assert (said.stdout.strip() or None) == commit()
