"""Reasons for findings on drives from other origins: speeds that are means, rules for single names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.test_beside_shapes import Given, columns, directions, noiseless
from tpmsd.car.physics.catalogue import FittedParameter, probes
from tpmsd.interfaces.cli.diagnose import read_recording
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS

PENALTY = 3.5


@pytest.mark.parametrize(("latency_s", "found"), [(0.0, []), (0.25, ["gnss_latency"])])
def test_speeds_that_are_means_over_an_interval_are_no_finding(
    tmp_path: Path, latency_s: float, found: list[str]
) -> None:
    """The age of means over 40 ms is a nuisance of the bus; GNSS latency is found beside it."""
    spec = Spec(
        duration_s=240.0,
        road="city",
        wheel_signal="speeds",
        speed_window_s=0.04,
        doppler_mps=0.02,
        doppler_tau_s=0.05,
        physics={"gnss_latency": {"latency_s": latency_s}},
    )
    write_folder(drive(spec, 21), tmp_path)

    diagnosis = diagnose([read_recording(tmp_path)])

    assert found == [finding.effect for finding in diagnosis.findings]


def one_of_each() -> list[FittedParameter]:
    """A number of each effect that is looked for in windows."""
    return list({probe.effect: probe for probe in probes() if probe.parameter}.values())


@pytest.mark.parametrize("probe", one_of_each(), ids=lambda probe: probe.effect)
def test_one_threshold_holds_for_all_names(probe: FittedParameter) -> None:
    """A gain of a nat above penalty and threshold is chosen, of a nat below is not, whatever the name."""
    value = probe.value - probe.neutral
    term = Term(
        probe.effect,
        columns(1, width=2),
        (probe.parameter,),
        PENALTY,
        pattern=probe.wheel_pattern,
        at=probe.at,
    )
    threshold = term.total_penalty(value) + SETTINGS.selection.admit_nats
    response = directions(1)

    for nats, chosen in ((threshold - 1.0, []), (threshold + 1.0, [probe.effect])):
        length = np.sqrt(2.0 * nats)
        selector = Selector(
            noiseless(length * response[:, 0], length / value * response), Given(2, [term], [])
        )

        assert chosen == [one.term.effect for one in selector.select().chosen]
