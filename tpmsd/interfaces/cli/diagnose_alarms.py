"""Replays drives without and with the model that `tpmsd diagnose` found, beside the diagnosis.

In: drive folders. Out: `AlarmsCompared`. The replay without the model runs in a process of its own while the
diagnosis is at work, so that two cores are used.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.offline.diagnosis.assessment.result import RollingDiagnosis
    from tpmsd.offline.report.alarms_compared import AlarmsCompared
    from tpmsd.offline.report.replay_result import ReplayResult

WORKERS = 2


class AlarmReplays:
    """A context within which the replays run; what is not needed any more is given up at its end."""

    def __init__(self, drives: Sequence[Path], config_file: Path | None) -> None:
        self._drives, self._config_file = list(drives), config_file
        self._pool = ProcessPoolExecutor(WORKERS)
        self._before: list[Future[ReplayResult]] = []

    def __enter__(self) -> AlarmReplays:
        self._before = [self._submit_replay(drive, None) for drive in self._drives]
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def _submit_replay(self, drive: Path, model: ExtendedModel | None) -> Future[ReplayResult]:
        return self._pool.submit(replayed, drive, self._config_file, model)

    def compared(self, diagnosis: RollingDiagnosis) -> list[AlarmsCompared]:
        """Return all drives without and with the diagnosed model; waits for the replays."""
        from tpmsd.car.config.load import load_config
        from tpmsd.car.physics.effect import Kind
        from tpmsd.offline.report.alarms_compared import compare_alarms
        from tpmsd.onboard.timeline.compensation import uncompensated_effects

        model, notes = diagnosis.model, []
        after: list[Future[ReplayResult] | None] = []
        for drive in self._drives:
            config = load_config(drive if self._config_file is None else self._config_file)
            notes.append(tuple(uncompensated_effects(config, model)))
            nothing = all(effect.kind is Kind.FAULT for effect in model)
            after.append(None if nothing else self._submit_replay(drive, model))
        return [
            compare_alarms(
                drive.resolve().name,
                one.result(),
                None if two is None else two.result(),
                diagnosis.findings,
                note,
            )
            for drive, one, two, note in zip(self._drives, self._before, after, notes, strict=True)
        ]


def replayed(drive: Path, config_file: Path | None, model: ExtendedModel | None) -> ReplayResult:
    """Replay a drive with its notes suppressed: the diagnosis has printed them already."""
    from tpmsd.car.config.load import load_config
    from tpmsd.interfaces.cli.replay import replay

    with contextlib.redirect_stderr(io.StringIO()):
        return replay(drive, load_config(drive if config_file is None else config_file), model)
