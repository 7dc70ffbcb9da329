"""Summary, document and page of a diagnosis that was written by hand."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.offline.report.pages import ORIGIN, Page
from tests.offline.report.test_alarms_compared import LEAK
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.assessment.reach import ChannelReach, Reach
from tpmsd.offline.diagnosis.assessment.result import (
    DriveMap,
    Finding,
    NotDetectable,
    PictureData,
    Quantity,
    RadiusDrift,
    RollingDiagnosis,
    Trace,
    Where,
)
from tpmsd.offline.report.diagnosis_document import diagnosis_document
from tpmsd.offline.report.diagnosis_page import diagnosis_page
from tpmsd.offline.report.diagnosis_sentences import summary_sentences
from tpmsd.offline.report.diagnosis_summary import diagnosis_summary, reach_sentence, remainder_sentences

SHAPE = Finding(
    effect="unknown",
    confidence=0.999,
    parameters={},
    where=Where(("rl", "rr"), "wheel_ratio", "speed", (12.0, 30.0)),
    rms_before=1.7,
    rms_after=0.9,
    loglik_gain_per_s=10.0,
    gain=12_000.0,
    indistinguishable_from=(),
    shape=((10.0, 0.0, 0.0), (20.0, -1.4e-3, 5e-5), (30.0, -1e-4, 4e-5)),
)
LATENCY = replace(
    LEAK,
    effect="gnss_latency",
    parameters={"latency_s": Quantity(0.1, 0.004, "s")},
    where=Where((), "gnss_speed", "accel_long", (-2.0, 1.5)),
    indistinguishable_from=("antenna_lever_arm",),
    advice="brake hard on a straight",
)
REACH = Reach(300.0, 100.0, 20.0, {"gnss_speed": ChannelReach(300.0, 100.0, 0.31, 1e-9)})
BENDS = np.linspace(-2.0, 2.0, 8)
FOUND = RollingDiagnosis(
    verdict="mismatch",
    reason="",
    findings=(SHAPE, LATENCY),
    driving_s=1200.0,
    baseline_rms=1.8,
    baseline_loglik_per_s=-3.0,
    model_rms=0.9,
    unexplained=None,
    model=ExtendedModel(),
    evidence=(("gnss_latency", 400.0), ("lateral_slip", 3.0), ("road_grade", -1.0)),
    notes=("tuesday: left out, for the drive is shorter than 90 s",),
    reach=REACH,
    inner=PictureData(
        rms_by_channel={"gnss_speed": (1.8, 0.9)},
        traces=(
            Trace("unknown", "speed", BENDS + 20.0, 10.0 * BENDS, 0.1 * BENDS),
            Trace("gnss_latency", "accel_long", BENDS, 10.0 * BENDS, 0.1 * BENDS),
        ),
        ground=DriveMap(BENDS * 100.0, BENDS * 10.0, BENDS),
    ),
)


def test_the_summary_says_where_a_shape_goes() -> None:
    """The deepest and the highest place of a shape, in millimetres with their std."""
    text = diagnosis_summary(FOUND, "model.toml")

    assert "from -1.4 +- 0.05 mm at 20 m/s to 0 mm at 10 m/s" in text
    assert "this drive cannot tell it from: antenna_lever_arm" in text
    assert text.endswith("The extended model is in model.toml.")


@pytest.mark.parametrize(
    ("reach", "sentence"),
    [
        (
            REACH,
            "Of the held-out gain of a nonparametric model, 75 % was reached; 100 +- 20 nats are "
            "left, most of them in the receiver's speed.",
        ),
        (
            replace(REACH, left=-1.25, left_std=3.0),
            "Of the held-out gain of a nonparametric model, 100 % was reached; "
            "beyond that it has no significant gain (-1.2 +- 3 nats).",
        ),
        (
            replace(REACH, left=-1575.0, left_std=1100.0),
            "Of the held-out gain of a nonparametric model, 100 % was reached; beyond that it has no "
            "significant gain (-1575 +- 1.1e+03 nats: it fits noise, and predicts worse than the findings).",
        ),
        (
            replace(REACH, found=0.0, left=2.0, left_std=3.0),
            "A nonparametric model has no significant held-out gain either (2 +- 3 nats).",
        ),
        (
            replace(REACH, found=0.0),
            "Of the held-out gain of a nonparametric model, 0 % was reached; 100 +- 20 nats are "
            "left, most of them in the receiver's speed.",
        ),
    ],
)
def test_what_is_left_is_said_in_a_sentence(reach: Reach, sentence: str) -> None:
    """Noise, structure, or nothing to reach at all."""
    assert sentence == reach_sentence(reach)


RADIUS_DRIFT = RadiusDrift(7e-4, 60.0, "monday", Where(("rl", "rr"), "wheel_ratio", "time", (0.0, 600.0)))
ALL = replace(REACH, left=-15.0, left_std=34.0)
NOTHING_LEFT = reach_sentence(ALL)
ALL_REACHED = replace(FOUND, reach=ALL)


@pytest.mark.parametrize(
    ("diagnosis", "sentences"),
    [
        (ALL_REACHED, [NOTHING_LEFT]),
        (
            replace(ALL_REACHED, drift=RADIUS_DRIFT),
            [
                NOTHING_LEFT,
                "All of this is beside radii of monday that drift by 0.07 % within 60 s (rl rr), more than "
                "tyres and roads make them: this is taken as noise, and its cause is not known.",
            ],
        ),
        (
            replace(ALL_REACHED, unexplained=RADIUS_DRIFT.where),
            [
                NOTHING_LEFT,
                "One more term alone would still explain structure: differences between wheels (rl rr), "
                "over time from 0 to 600 s.",
            ],
        ),
    ],
)
def test_what_is_left_is_reported_without_contradiction(
    diagnosis: RollingDiagnosis, sentences: list[str]
) -> None:
    """Drift that passes for noise is said to be that, on page and in summary, and not what is unexplained."""
    page = diagnosis_page(diagnosis, ["monday"], ORIGIN)
    summary = diagnosis_summary(diagnosis, None)
    assert sentences == remainder_sentences(diagnosis)
    assert all(one in summary for one in sentences)
    assert all(one.replace("+-", "±") in html.unescape(page) for one in sentences)
    assert "Still unexplained" not in page


def test_drift_that_passes_for_noise_is_a_number_in_the_document() -> None:
    """It counts as unexplained, with its size."""
    document = diagnosis_document(replace(FOUND, drift=RADIUS_DRIFT), None)["unexplained"]
    assert (True, ["rl", "rr"]) == (document["significant"], document["where"]["wheels"])
    assert {"relative_std": 7e-4, "time_constant_s": 60.0, "drive": "monday"} == document["radius_drift"]


def test_the_document_has_what_was_reached() -> None:
    """Share and gains as numbers, by channel too; null where nothing was to be reached."""
    document = json.loads(json.dumps(diagnosis_document(FOUND, None), allow_nan=False))
    nothing = diagnosis_document(replace(FOUND, reach=replace(REACH, found=0.0, left=0.0)), None)

    assert (0.75, True) == (document["reach"]["share"], document["reach"]["structured"])
    assert 0.31 == document["reach"]["channels"]["gnss_speed"]["correlation"]
    assert nothing["reach"]["share"] is None
    assert "alarms" not in document
    assert [1.0, 1.0, 1.0] == [len(s) / 3 for s in document["findings"][0]["shape"]]


def test_the_page_shows_every_finding() -> None:
    """Gains, term and residual of the unknown, residual of the latency, map, evidence: six pictures."""
    page = Page(diagnosis_page(FOUND, ["monday", "<tuesday>"], ORIGIN))

    assert 6 == page.tags["svg"]
    assert 3 == len(page.data)
    assert "Diagnosis of monday, <tuesday>" in page.text
    assert "left out, for the drive is shorter than 90 s" in page.text
    assert "2. GNSS latency" in page.text
    assert "latency|0.1 ± 0.004 s" in page.text
    assert "GNSS latency|Antenna lever arm|brake hard on a straight" in page.text
    assert "Road grade" not in page.text


def test_the_page_says_how_certain_a_finding_is() -> None:
    """Status and p-value of each finding; a suspicion is not counted as a finding."""
    doubtful = replace(LATENCY, status="suspicion", p_value=0.2)
    page = Page(diagnosis_page(replace(FOUND, findings=(SHAPE, doubtful)), ["monday"], ORIGIN))

    assert "1 finding and 1 suspicion" in page.text
    assert "GNSS latency|suspicion|0.2|" in page.text
    assert "A suspicion, which noise may make as well (p 0.2)" in page.text


def test_a_p_value_that_no_replicate_reached_is_printed_as_a_bound() -> None:
    """`<=` where no replicate showed as much; a counted one is itself."""
    least, counted = replace(LATENCY, p_value=0.125, p_value_is_bound=True), replace(LATENCY, p_value=0.25)
    found = replace(FOUND, findings=(least, counted))
    text = diagnosis_summary(found, None)
    page = Page(diagnosis_page(found, ["monday"], ORIGIN))

    assert [", p <= 0.1)", ", p 0.2)"] == re.findall(r", p .*?\)", text)
    assert "GNSS latency|finding|<= 0.1|" in page.text
    assert "GNSS latency|finding|0.2|" in page.text
    assert [" (p <= 0.1)", " (p 0.2)"] == re.findall(r" \(p .*?\)", page.text)


def test_small_lengths_are_in_millimetres_on_the_page() -> None:
    """A change of radius reads in millimetres, with its standard deviation."""
    page = Page(diagnosis_page(replace(FOUND, findings=(LEAK,)), ["monday"], ORIGIN))

    assert "deviation|-2 ± 0.01 mm" in page.text


def test_insufficient_data_have_a_page_too() -> None:
    """The reason, and no empty tables."""
    nothing = replace(FOUND, verdict="insufficient_data", reason="the car stood", inner=None, reach=None)
    page = Page(diagnosis_page(nothing, ["monday"], ORIGIN))

    assert "Insufficient data: the car stood." in page.text
    assert 0 == page.tags["table"]


UNSEEN = (
    NotDetectable("centrifugal_growth", {"coefficient": (1.5e-6, "s2/m")}),
    NotDetectable("antenna_lever_arm", {"forward_m": (0.5, "m"), "left_m": (None, "m")}),
    NotDetectable("drive_split", {"difference": (None, "s2/m")}),
)


def test_the_answer_comes_first() -> None:
    """Findings in the words of their effects, notes, and what the drive would not show; then all else."""
    found = replace(FOUND, not_detectable=UNSEEN)
    answer = (
        "Something without a name acts on rear left and rear right over speed. The fixes are 100 +- 4 ms"
        " older than configured. This drive cannot tell age of the fixes from an antenna out of place."
        " Tuesday: left out, for the drive is shorter than 90 s. No other deviation from the rolling"
        " model was found. This drive would not show growth with speed below 1.5e-6 s2/m or an antenna out of"
        " place below 0.50 m."
    )
    text = diagnosis_summary(found, None)
    page = diagnosis_page(found, ["monday"], ORIGIN)

    assert text.startswith(answer + "\n\n1200 s of driving")
    assert "centrifugal_growth          coefficient 1.5e-06 s2/m" in text
    assert "Nothing of these shows on such a drive: drive_split." in text
    assert diagnosis_document(found, None)["summary"] == answer
    assert html.unescape(page).index(answer.replace("+-", "±")[:60]) < page.index("<h2>")
    assert page.index("<figure") < page.index("<h2>")
    keys = re.findall(r'<figure id="([^"]+)"', page)
    assert len(keys) == len(set(keys))
    assert "Growth with height" not in page


def test_what_may_be_unseen_is_a_table_in_the_document() -> None:
    """Effects with value and unit by parameter; null where nothing of it shows."""
    document = json.loads(json.dumps(diagnosis_document(replace(FOUND, not_detectable=UNSEEN), None)))
    assert document["not_detectable"] == [
        {"effect": "centrifugal_growth", "smallest": {"coefficient": {"value": 1.5e-6, "unit": "s2/m"}}},
        {
            "effect": "antenna_lever_arm",
            "smallest": {"forward_m": {"value": 0.5, "unit": "m"}, "left_m": {"value": None, "unit": "m"}},
        },
        {"effect": "drive_split", "smallest": {"difference": {"value": None, "unit": "s2/m"}}},
    ]


def test_a_drive_that_agrees_says_so_first() -> None:
    """And, too, what the drive would not show; insufficient data say their reason."""
    agrees = replace(FOUND, verdict="consistent", findings=(), notes=(), not_detectable=UNSEEN[:1])
    assert summary_sentences(agrees) == [
        "The drive agrees with the rolling model within the noise.",
        "This drive would not show growth with speed below 1.5e-6 s2/m.",
    ]
    short = replace(FOUND, verdict="insufficient_data", reason="no drive")
    assert summary_sentences(short) == ["Nothing can be concluded: no drive."]


@pytest.mark.parametrize(
    ("held_by", "begin"),
    [
        ("recording", "What your simulation lacks: the fixes are"),
        ("simulation", "What your simulation has and the recording has not"),
        ("both", "What your simulation has at another size"),
    ],
)
def test_a_sentence_says_who_holds_an_effect(held_by: str, begin: str) -> None:
    """Against a simulation a finding is of one of the two."""
    found = replace(FOUND, findings=(replace(LATENCY, held_by=held_by),), baseline=("simulation",))
    assert summary_sentences(found)[0].startswith(begin)
