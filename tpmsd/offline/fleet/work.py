"""Result of one drive: replayed, calibrated and diagnosed, as one document of plain values.

In: the store's path and a drive's key. Out: the drive's result file. This runs in the workers. A drive that
cannot be used is a result with its reason; one that took its worker down `tries` times is set aside. The
document holds neither times of computing nor paths, so the same drive gives the same bytes wherever it is
worked on.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.plain import plain
from tpmsd.foundation.startup import keep_freed_memory
from tpmsd.foundation.version import __version__
from tpmsd.offline.fleet.find_drives import local_copy
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.fleet.store import Store

SCHEMA = "tpmsd.fleet.drive/1"
STAGES = ("replay", "calibrate", "diagnose")


def program() -> str:
    """Return the program version under which results are stored, such as `tpmsd 1.0`."""
    return f"tpmsd {__version__}"


def is_missing(result: dict[str, Any] | None, stages: tuple[str, ...], recompute: bool) -> bool:
    """Return whether a drive still has to be worked on.

    Results of another program version count, unless `recompute` asks for new ones.
    """
    if result is None or (recompute and result.get("program") != program()):
        return True
    return not set(stages) <= set(result.get("stages", ())) and result.get("status") != "set_aside"


def work_on_drive(store_path: str, key: str, stages: tuple[str, ...], run: str) -> str:
    """Make and store the result of one drive; return its status: done, failed or set_aside."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    keep_freed_memory()  # Dask's workers give every page back at once, a third of a drive's time
    store = Store.open(Path(store_path))
    number = store.begin_try(key, run)
    if number > SETTINGS.tries or store.tries_of(key) > SETTINGS.tries_in_all:
        reason = f"its worker died {number - 1} times"
        result = _result_document("set_aside", reason, stages, {})
    else:
        result = make_result(store.entry(key).path, stages)
    store.write_result(key, result)
    store.end_try(key)
    return str(result["status"])


def make_result(path: str, stages: tuple[str, ...] = STAGES) -> dict[str, Any]:
    """Return the result of one drive, as a document."""
    try:
        with local_copy(path) as folder:
            parts = _run_stages(folder, stages)
    except TpmsdError as error:
        reason = str(error).splitlines()[0].replace(path, "DRIVE")
        return _result_document("failed", reason, stages, {})
    except Exception as error:  # a defect of the program is a row, too, and never the end of the run
        reason = " ".join(f"internal error: {type(error).__name__}: {error}".split())
        return _result_document("failed", reason.replace(path, "DRIVE"), stages, {})
    return _result_document("done", "", stages, parts)


def _result_document(
    status: str, reason: str, stages: tuple[str, ...], parts: dict[str, Any]
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "program": program(),
        "status": status,
        "reason": reason,
        "stages": list(stages),
        **parts,
    }


def _run_stages(folder: Path, stages: tuple[str, ...]) -> dict[str, Any]:
    # Imported here: the client, which only hands out keys, needs none of it.
    from tpmsd.offline.drives.drive import load
    from tpmsd.offline.drives.playing import known_effects, recording_of, replay_drive, replays_at_desk_rate
    from tpmsd.offline.report.replay_document import replay_document
    from tpmsd.onboard.timeline.tick import Tick

    drive = load(folder)
    # The drive is decoded once: what follows takes the replay's ticks.
    ticks: list[Tick] | None = [] if "replay" in stages and replays_at_desk_rate(drive) else None
    recording = cache(lambda: recording_of(drive, "the drive", ticks))
    parts: dict[str, Any] = {}
    if "replay" in stages:
        result, _ = replay_drive(drive, collected=ticks)
        document = replay_document(result)
        for name in ("drive", "realtime_factor", "resonance", "pose"):
            document.pop(name, None)
        parts["replay"] = _round_numbers(plain(document))
    if "calibrate" in stages:
        from tpmsd.offline.calibration.checks import RefusedError
        from tpmsd.offline.calibration.nominal import vehicle_of
        from tpmsd.offline.calibration.statistics import drive_statistics

        try:
            statistics = drive_statistics(recording(), vehicle_of(drive.config.vehicle))
        except (RefusedError, TpmsdError) as error:
            parts["calibrate"] = {"reason": str(error).replace(str(folder), "DRIVE"), "statistics": None}
        else:
            parts["calibrate"] = {
                "reason": "",
                "statistics": _round_numbers(plain(_packed_statistics(statistics))),
            }
    if "diagnose" in stages:
        from tpmsd.offline.diagnosis.diagnose import diagnose
        from tpmsd.offline.report.diagnosis_document import diagnosis_document

        found = diagnose([recording()], known=known_effects([drive]))
        document = diagnosis_document(found, None)
        kept = ("verdict", "reason", "findings", "driving_s")
        parts["diagnose"] = _round_numbers(plain({name: document[name] for name in kept}))
    return parts


def _packed_statistics(statistics: Any) -> dict[str, Any]:
    """Return the statistics with the information matrix as its lower triangle, row by row."""
    rows = statistics.information.tolist()
    triangle = [value for k, row in enumerate(rows) for value in row[: k + 1]]
    return {"names": statistics.names, "information": triangle, "vector": statistics.vector}


def _round_numbers(value: Any) -> Any:
    """Return the value with all numbers in it rounded to the digits that are stored."""
    if isinstance(value, float):
        return float(f"{value:.{SETTINGS.digits}g}")
    if isinstance(value, dict):
        return {key: _round_numbers(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_round_numbers(one) for one in value]
    return value
