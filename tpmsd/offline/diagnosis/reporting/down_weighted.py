"""Part of the data that robust weights took out, and where.

In: the drives with the factors on their variances. Out: `DownWeighted`. A reading whose variance was inflated
by f keeps the weight 1 / f; what it lost, 1 - 1 / f, is counted. Events were looked for before, so that this
is what no hypothesis explains.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.offline.diagnosis.assessment.result import DownWeighted
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.windows import CHANNEL_NAMES


def down_weighted(drives: Sequence[DriveRegression]) -> DownWeighted:
    """Return the fraction of the data that robust weights removed, in all and by channel; time spans are of
    the first drive."""
    lost, channel_of, here = [], np.array(CHANNEL_NAMES), []
    spans: list[tuple[float, float]] = []
    for number, drive in enumerate(drives):
        measured = np.isfinite(drive.reader.windows.measured)
        factor = np.ones(measured.shape) if drive.inflate is None else drive.inflate
        gone = np.where(measured, 1.0 - 1.0 / np.maximum(factor, 1.0), 0.0)
        lost.append(gone)
        here.append(measured)
        if number == 0:
            spans = _down_weighted_spans(drive, gone, measured)
    gone, measured = np.concatenate(lost), np.concatenate(here)
    by_channel = {
        name: float(gone[:, channel_of == name].sum() / max(measured[:, channel_of == name].sum(), 1))
        for name in dict.fromkeys(CHANNEL_NAMES)
        if measured[:, channel_of == name].any()
    }
    return DownWeighted(float(gone.sum() / max(measured.sum(), 1)), by_channel, tuple(spans))


def _down_weighted_spans(
    drive: DriveRegression, gone: np.ndarray, measured: np.ndarray
) -> list[tuple[float, float]]:
    """Return the spans (s) of neighbouring blocks of which a large fraction was removed."""
    total = np.bincount(drive.blocks, gone.sum(axis=1))
    share = total / np.maximum(np.bincount(drive.blocks, measured.sum(axis=1)), 1)
    time_s = drive.reader.windows.time_s
    out: list[tuple[float, float]] = []
    for block in np.flatnonzero(share > SETTINGS.report.much_removed):
        at = time_s[drive.blocks == block]
        begin, end = float(at[0] - 0.5), float(at[-1] + 0.5)
        if out and begin - out[-1][1] < 1.5:
            begin = out.pop()[0]
        out.append((begin, end))
    return out
