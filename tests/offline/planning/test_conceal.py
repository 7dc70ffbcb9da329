"""Effects to be concealed are those that a recording can show, at twice its limit or more."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS, FAULT, make_effect
from tpmsd.car.physics.effect import Parameter
from tpmsd.offline.diagnosis.assessment.identifiability import prior_scale
from tpmsd.offline.diagnosis.reporting.detectable import not_detectable
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.planning.conceal import LIMITS, LOSS_M, MOST, RecordingInformation, draw_effects

LATE = {"gnss_latency": {"latency_s": 0.2}}


@pytest.fixture(scope="module")
def showing() -> RecordingInformation:
    """A drive with a latency of its own."""
    spec = Spec(duration_s=300.0, road="rural", doppler_mps=0.03, position_slow_m=0.6, physics=LATE)
    return RecordingInformation(recording_of(drive(spec, 5)), lambda share: None)


def test_the_limit_is_that_of_the_diagnosis(showing: RecordingInformation) -> None:
    """`not_detectable` of the untouched recording says the same numbers."""
    regression, selection, evidence = showing.found

    stated = not_detectable(regression, selection, Selector(evidence, regression.hypotheses))

    assert len(stated) > 3
    for one in stated:
        for name, (size, _) in one.smallest.items():
            assert showing.smallest_detectable_size(one.effect, name) == (math.inf if size is None else size)


def test_sizes_are_twice_the_limit_and_plausible(showing: RecordingInformation) -> None:
    """Each of twelve is at least twice the limit and at most thrice the usual size."""
    names = set()
    for seed in range(12):
        (effect,) = draw_effects(showing, 1, np.random.default_rng(seed))
        names.add(effect.name)
        values: dict[str, Any] = dict(effect.values())
        if effect.name == FAULT.name:
            limit = showing.smallest_detectable_loss(
                *(values[key] for key in ("wheel", "onset_s", "duration_s"))
            )
            size, usual = -values["deviation_m"], LOSS_M
        else:
            first = next(name for name, value in values.items() if isinstance(value, float) and value)
            parameter = next(p for p in EFFECTS[effect.name].parameters if p.name == first)
            assert isinstance(parameter, Parameter)
            limit, size = (
                showing.smallest_detectable_size(effect.name, first),
                abs(values[first] - parameter.neutral),
            )
            usual = prior_scale(EFFECTS[effect.name], first)
        assert 0.99 * LIMITS[0] * limit <= size <= 1.01 * MOST * usual
    assert len(names) > 2


def test_what_the_recording_holds_is_known_and_not_drawn(
    showing: RecordingInformation, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drive's own latency is found; of two effects that are drawn most, none is where it holds them."""
    assert showing.present_effects == {"gnss_latency"}
    assert showing.latency_s == pytest.approx(0.2, abs=0.03)
    often = {"inner_wheel_slip", "gyro_drift"}

    def drawn() -> set[str]:
        return {draw_effects(showing, 1, np.random.default_rng(seed))[0].name for seed in range(12)}

    assert often & drawn()
    monkeypatch.setattr(RecordingInformation, "present_effects", often)
    assert not often & drawn()


def test_a_late_or_long_loss_is_harder_to_show(showing: RecordingInformation) -> None:
    """The limit falls with the time that a lost radius is there; beyond the end nothing shows."""
    duration_s = showing.duration_s

    sizes = [showing.smallest_detectable_loss("rl", share * duration_s, 0.0) for share in (0.5, 0.85, 0.95)]

    assert sizes == sorted(sizes)
    assert sizes[0] < 0.6 * sizes[-1]
    assert showing.smallest_detectable_loss("rl", duration_s + 10.0, 0.0) == math.inf
    assert make_effect(FAULT.name, wheel="rl", deviation_m=-sizes[0]) is not None
