"""Wheels on one bus, gyro on another: what the log of both gives."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from tpmsd.interfaces.cli.main import main


def replayed(folder: Path) -> dict[str, Any]:
    """What `tpmsd replay` says of the drive in `folder`."""
    target = folder / "replay.json"
    assert 0 == main(["replay", str(folder), "--json", str(target)])
    document: dict[str, Any] = json.loads(target.read_text())
    return document


def test_a_gyro_on_a_further_bus(tmp_path: Path) -> None:
    """A gyro that comes by a second bus replays to the same wheels; on the wrong bus it is not heard."""
    one, two, deaf = tmp_path / "one", tmp_path / "two", tmp_path / "deaf"
    assert 0 == main(["simulate", str(one), "--bus", "split", "--route", "city", "--duration", "60"])
    car = (one / "vehicle.toml").read_text()
    further = car.replace('dbc = "bus.dbc"\n', 'dbc = "bus.dbc"\nbuses = { motion = "can7" }\n', 1)
    further = re.sub(r'= ("GYRO\.\w+")', r'= { signal = \1, bus = "motion" }', further)
    log = (one / "can.log").read_text().replace(" can0 1B0#", " can7 1B0#")
    for folder, text in ((two, further), (deaf, car)):
        folder.mkdir()
        for name in ("bus.dbc", "gnss.nmea"):
            (folder / name).write_bytes((one / name).read_bytes())
        (folder / "vehicle.toml").write_text(text)
        (folder / "can.log").write_text(log)

    expected = replayed(one)["wheels"]
    assert expected == replayed(two)["wheels"]
    assert expected != replayed(deaf)["wheels"]
