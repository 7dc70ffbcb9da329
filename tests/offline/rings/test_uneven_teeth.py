"""Uneven teeth on buses that read a wheel less than twice per revolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.rings.uneven_teeth import Ripple, _fit_ripple, ripples

READ_HZ, EDGES_S, LATE_S = 20.0, 0.02, 0.013
"""A control unit's readings, half the time whose edges it takes, and how late the first one comes."""


def summed_speeds(seed: int, wheel: str = "", amplitude_rad: float = 0.0) -> Recording:
    """A drive as a bus of speeds gives it: readings of 50 ms, summed to angles by the trapezoid."""
    driven = drive(Spec(duration_s=700.0, road="motorway"), seed)
    recording = recording_of(driven, counted=False)
    read_s = np.arange(LATE_S, driven.time_s[-1] - EDGES_S, 1.0 / READ_HZ)
    ticks_s = np.arange(len(recording.rotation_rad) + 1) * recording.dt_s
    rotation = np.empty_like(recording.rotation_rad)
    for k, name in enumerate(WHEELS):
        turned = [
            np.interp(read_s + side, driven.time_s, driven.shown_rad[:, k]) for side in (-EDGES_S, EDGES_S)
        ]
        first, last = (angle + amplitude_rad * (name == wheel) * np.sin(angle + 1.0) for angle in turned)
        omega = (last - first) / (2 * EDGES_S)
        angle = np.concatenate([[0.0], np.cumsum((omega[1:] + omega[:-1]) / 2 / READ_HZ)])
        rotation[:, k] = np.diff(np.interp(ticks_s, read_s, angle))
    return replace(recording, rotation_rad=rotation, quantum_rad=np.zeros(4))


def found_in(recording: Recording) -> list[Ripple]:
    """The ripples of a recording."""
    readers, notes = admitted_readers([recording])
    assert not notes
    reader: Reader = readers[0]
    return ripples(reader.recording, reader.reference)


@pytest.mark.parametrize("wheel", WHEELS)
def test_a_folded_ripple_is_found_on_its_wheel(wheel: str) -> None:
    """10 to 17 turns a second, 20 readings: another size, phase and sign at every speed."""
    found = found_in(summed_speeds(31, wheel, 0.01))

    assert [wheel] == [one.wheel for one in found]
    assert found[0].amplitude_rad == pytest.approx(0.01, abs=2.5 * found[0].std_rad)


def test_even_teeth_have_no_folded_ripple() -> None:
    """Twelve ranges of speeds, each with a sine and a cosine, find nothing where there is nothing."""
    assert [] == found_in(summed_speeds(31))


def test_a_range_of_speeds_met_in_one_fold_alone_is_judged() -> None:
    """A ripple whose regressors stand only in blocks that are held out together is judged, not a crash."""
    rng = np.random.default_rng(3)
    blocks = np.repeat(np.arange(20), 100)
    regressors = rng.standard_normal((2000, 4))
    regressors[blocks % 5 != 2, 1::2] = 0.0
    rows = rng.standard_normal((2000, 4))
    rows[:, 1] += 0.5 * 0.75 * regressors[:, 0]
    ripple = _fit_ripple(1, rows, regressors, blocks)
    assert ripple is not None
    assert ripple.wheel == "fr"
