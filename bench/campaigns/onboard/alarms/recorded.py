"""The real recordings: nothing was wrong with any tyre, so any alarm of a tyre is a false one.

In: a folder of drive folders. Out: a row for each.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.campaigns.onboard.alarms.play import with_method
from tpmsd.car.config.load import load_config
from tpmsd.foundation.errors import TpmsdError
from tpmsd.interfaces.cli.replay import replay


def recordings(folder: Path) -> list[Path]:
    """Drive folders below it, in order; none if it is not there."""
    return sorted(path.parent for path in folder.glob("*/vehicle.toml"))


def play_recordings(folder: Path, method: str | None = None) -> Iterator[dict[str, Any]]:
    """A row per recording; `method`: an estimator instead of the configured one."""
    for drive in recordings(folder):
        begun = time.process_time()
        try:
            result = replay(drive, with_method(load_config(drive), method))
        except TpmsdError as error:
            yield {"what": "failed", "name": drive.name, "error": str(error)}
            continue
        raised = [alarm for alarm in result.alarms if alarm.state == "raised"]
        yield {
            "what": "recording",
            "name": drive.name,
            "km": result.distance_m / 1000.0,
            "learned": result.learning_fraction >= 1.0,
            "tyre_alarms": [
                [alarm.time_s - result.start_s, str(alarm.kind), alarm.wheel]
                for alarm in raised
                if alarm.kind != "malfunction"
            ],
            "malfunctions": [alarm.reason for alarm in raised if alarm.kind == "malfunction"],
            "cpu_s": round(time.process_time() - begun, 2),
        }
