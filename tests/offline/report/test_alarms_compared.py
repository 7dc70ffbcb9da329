"""What missing physics means for the tyres, on replays whose numbers are known."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

import pytest

from tests.offline.report.drives import START_S, Drive, alarm
from tpmsd.offline.diagnosis.assessment.result import Finding, Quantity, Where
from tpmsd.offline.report.alarms_compared import alarms_document, alarms_summary, compare_alarms
from tpmsd.offline.report.diagnosis_figures import radius_chart
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind

LEAK = Finding(
    effect="radius_change",
    confidence=1.0,
    parameters={
        "wheel": Quantity("rl", None, ""),
        "deviation_m": Quantity(-2e-3, 1e-5, "m"),
        "onset_s": Quantity(300.0, 1.0, "s"),
        "duration_s": Quantity(0.0, 1.0, "s"),
    },
    where=Where(("rl",), "wheel_ratio", "time", (300.0, 600.0)),
    rms_before=2.0,
    rms_after=1.0,
    loglik_gain_per_s=1.0,
    gain=600.0,
    indistinguishable_from=(),
)
DEFLATION = AlarmKind.DEFLATION


def replayed(alarms: Sequence[AlarmEvent] = (), wave_m: float = 0.0, leak_m: float = 0.0) -> ReplayResult:
    """Ten minutes in which all radii wave by a minute's sine and the rear left one steps at 300 s."""

    def change(t: float) -> list[float]:
        wave = wave_m * math.sin(2 * math.pi * t / 60.0)
        return [wave, wave, wave + (leak_m if t > 300.0 else 0.0), wave]

    at: dict[int, tuple[AlarmEvent, ...]] = {round(2 * (one.time_s - START_S)) - 1: (one,) for one in alarms}
    return Drive(dt_s=0.5, change_m=change, events=at).record().result(1.0)


@pytest.mark.parametrize(
    ("before", "after", "findings", "sentence"),
    [
        (
            [alarm(400.0, DEFLATION, "fl")],
            [],
            [],
            "A false alarm goes: deflation of the front left wheel at 6:40.",
        ),
        (
            [],
            [alarm(400.0, DEFLATION, "rl")],
            [LEAK],
            "A hidden leak appears: deflation of the rear left wheel at 6:40.",
        ),
        (
            [alarm(500.0, DEFLATION, "rl")],
            [alarm(400.0, DEFLATION, "rl")],
            [LEAK],
            "Deflation of the rear left wheel is announced 1:40 sooner.",
        ),
        (
            [alarm(400.0, DEFLATION, "rl")],
            [alarm(500.0, DEFLATION, "rl")],
            [LEAK],
            "Deflation of the rear left wheel is announced 1:40 later.",
        ),
        (
            [alarm(400.0, DEFLATION, "rl")],
            [],
            [LEAK],
            "An alarm is lost: deflation of the rear left wheel at 6:40.",
        ),
        (
            [],
            [alarm(400.0, DEFLATION, "fr")],
            [LEAK],
            "A new alarm that no fault explains appears: deflation of the front right wheel at 6:40.",
        ),
    ],
)
def test_each_change_of_the_alarms_is_a_sentence(
    before: list[AlarmEvent], after: list[AlarmEvent], findings: list[Finding], sentence: str
) -> None:
    """Whether an alarm was false or a leak hidden is decided by the faults that were found."""
    compared = compare_alarms("d", replayed(before), replayed(after), findings)

    assert (sentence,) == compared.changes
    assert sentence in alarms_summary(compared)


def test_alarms_that_stay_need_no_word() -> None:
    """The same alarm at nearly the same time is no change."""
    one, two = replayed([alarm(400.0, DEFLATION, "rl")]), replayed([alarm(405.0, DEFLATION, "rl")])

    assert () == compare_alarms("d", one, two, [LEAK]).changes


def test_the_bias_is_the_scatter_without_the_fault() -> None:
    """A sine of 0.3 mm scatters by 0.3/sqrt(2) mm; a step that was found does not count."""
    before, after = replayed(wave_m=3e-4, leak_m=-2e-3), replayed(leak_m=-2e-3)
    found = {bias.wheel: bias for bias in compare_alarms("d", before, after, [LEAK]).wheels}
    missed = {bias.wheel: bias for bias in compare_alarms("d", before, after, []).wheels}

    assert {"fl", "fr", "rl", "rr"} == set(found)
    for bias in found.values():
        assert bias.before_m == pytest.approx(3e-4 / math.sqrt(2), rel=0.02)
        assert bias.after_m == pytest.approx(0.0, abs=1e-4)
    assert missed["rl"].after_m > 7e-4


def test_a_fault_of_another_drive_is_not_this_one_s() -> None:
    """A finding that stands in one drive only is no fault of the others."""
    elsewhere = Finding(**{**vars(LEAK), "drives": ("monday",)})

    assert () == compare_alarms("tuesday", replayed(), None, [elsewhere]).faults
    assert 1 == len(compare_alarms("monday", replayed(), None, [elsewhere]).faults)


def test_the_document_is_strict_json() -> None:
    """Alarms as in the replay's document, biases in millimetres by wheel."""
    compared = compare_alarms("d", replayed([alarm(400.0, DEFLATION, "fl")]), replayed(), [], ("stays",))
    document = json.loads(json.dumps(alarms_document(compared), allow_nan=False))

    assert ["deflation"] == [entry["kind"] for entry in document["before"]]
    assert ([], ["stays"], "d") == (document["after"], document["not_compensated"], document["drive"])
    assert {"before", "after", "estimate_std"} == set(document["radius_bias_mm"]["rl"])


def test_where_nothing_is_compensated_one_replay_serves() -> None:
    """Without anything to compensate the record says so."""
    compared = compare_alarms("d", replayed(), None, [])

    assert "Alarms of d: none; the model holds nothing to compensate." == alarms_summary(compared)


def test_each_wheel_has_a_figure_with_its_alarm() -> None:
    """Both replays on one time axis, the alarm at its time on its wheel's figure, the fault as found."""
    compared = compare_alarms(
        "d", replayed([alarm(400.0, DEFLATION, "rl")], leak_m=-2e-3), replayed(), [LEAK]
    )
    charts = [radius_chart(compared, wheel) for wheel in range(4)]

    assert [0, 0, 1, 0] == [len(chart.moments) for chart in charts if chart is not None]
    assert charts[2] is not None
    assert (400.0, "deflation RL") == (charts[2].moments[0].at, charts[2].moments[0].name)
    before, after, fault = charts[2].curves  # the wheel began 0.4 mm above nominal
    assert -2.0 == pytest.approx(before.y[-1] - 0.4, abs=0.01)
    assert 0.0 == pytest.approx(after.y[-1] - 0.4, abs=0.01)
    assert "change of radius as found" == fault.name
    assert -2.0 == pytest.approx(fault.y[-1] - 0.4, abs=0.01)
