"""Questions: what has probably changed and cannot be told is asked, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.test_unmasked import FIFTH_M, learned, raised
from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.alarms.judge import Judgement
from tpmsd.onboard.monitor.alarms.questions import Questions
from tpmsd.onboard.monitor.evidence.posterior import Posterior
from tpmsd.onboard.monitor.records import AlarmKind
from tpmsd.onboard.monitor.settings import FIRST_START, JUDGE

SETTINGS = MonitorConfig()
FRONT = 4
"""Place of the front axle among the subsets of four wheels: four single ones are before it."""


def found(of_front: float, unusual: float = 0.0, **models: float) -> Judgement:
    """Both front tyres have lost air with this probability, else none has."""
    subsets, sizes = np.zeros(15), np.zeros(9)
    subsets[FRONT], sizes[0] = of_front, 1.0
    wheels = np.array([of_front, of_front, 0.0, 0.0])
    bank = Posterior(wheels, wheels, np.zeros(4), subsets, sizes, {}, 0.0, 1.0 - of_front, of_front)
    return replace(Judgement.unknown(), posterior=bank, drive_models=models, unusual=unusual)


def asked(
    questions: Questions, of_front: float, seconds: int, *, alarm_active: bool = False
) -> tuple[str, ...]:
    """Wheels that are asked about after so long."""
    for second in range(seconds):
        models = {"as learned": of_front, "another load": 1.0 - of_front}
        questions.update(found(of_front, **models), 1.0, float(second), alarm_active=alarm_active)
    return questions.open[0].wheels if questions.open else ()


def test_what_lasts_is_asked_and_what_the_evidence_drops_is_not() -> None:
    """From the clearing threshold on, after the time that an alarm of all wheels takes; between that and the
    prior the question stands; at the prior and below it goes."""
    questions, hold_s = Questions(SETTINGS, [0, 1, 2, 3], "front"), round(JUDGE.all_hold_s)
    assert () == asked(questions, 0.64, hold_s - 5)
    assert ("fl", "fr") == asked(questions, 0.64, 10)
    assert "fl fr soft (0.64) or another load (0.36)" in questions.open[0].question
    assert ("fl", "fr") == asked(questions, 0.1, 100)
    assert () == asked(questions, 0.001, 70)
    assert () == asked(questions, SETTINGS.clear_probability - 0.01, 2 * hold_s)


def test_what_the_first_minutes_left_open_stands_down_to_their_prior() -> None:
    """Asked from the clearing threshold on; it stands above the prior that any tyre was soft or larger
    before, and goes at it."""
    questions, hold_s = Questions(SETTINGS, [0, 1, 2, 3], "front"), JUDGE.all_hold_s
    prior = 4 * (FIRST_START.soft_prior + FIRST_START.larger_prior)

    def stands(probability: float, seconds: float) -> bool:
        for _ in range(round(seconds)):
            questions.update_first_start((2, probability, "soft"), 1.0)
            questions.update(None, 1.0, 0.0, alarm_active=False)
        return bool(questions.open)

    assert not stands(SETTINGS.clear_probability - 0.01, 2.0 * hold_s)
    assert stands(SETTINGS.clear_probability + 0.01, hold_s + 5.0)
    assert stands(1.02 * prior, 2.0 * SETTINGS.clear_hold_s)
    assert not stands(0.98 * prior, SETTINGS.clear_hold_s + 5.0)


def test_what_an_alarm_says_is_not_asked() -> None:
    """An alarm of a tyre stands: there is no question, and after it one has to last again."""
    questions = Questions(SETTINGS, [0, 1, 2, 3], "front")
    assert ("fl", "fr") == asked(questions, 0.64, 200)
    assert () == asked(questions, 0.64, 1, alarm_active=True)
    assert () == asked(questions, 0.64, 100)


def test_a_question_keeps_the_time_at_which_it_was_first_asked() -> None:
    """And says the present probability."""
    questions = Questions(SETTINGS, [0, 1, 2, 3], "front")
    asked(questions, 0.64, 200)
    since_s = questions.open[0].since_s
    questions.update(found(0.5), 1.0, 9999.0, alarm_active=False)
    (standing,) = questions.open
    assert standing == replace(standing, since_s=since_s, probability=0.5)
    assert {"wheels", "question", "probability", "since"} == set(standing.entry())


@pytest.mark.parametrize("axle", [(0, 1), (2, 3)])
@pytest.mark.parametrize("seed", [20])
def test_two_tyres_of_an_axle_that_were_soft_at_the_beginning_are_not_silent(
    axle: tuple[int, int], seed: int
) -> None:
    """Both are 20 % low since before the second drive: within ten minutes an alarm of one of them, or a
    question about them."""
    drives = learned(seed)
    events = drives.drive(600.0, [FIFTH_M * (k in axle) for k in range(4)])
    named = set(raised(events, AlarmKind.DEFLATION)) | set(raised(events, AlarmKind.RADIUS_DEVIATION))
    for question in drives.monitor.questions:
        named |= set(question.wheels)
    assert named & {WHEELS[k] for k in axle}


def test_a_sound_car_asks_nothing() -> None:
    """Another drive in order."""
    drives = learned(21)
    drives.drive(900.0, (0.0,) * 4)
    assert () == drives.monitor.questions


def test_what_is_certainly_other_than_learned_is_asked_and_names_the_axle_that_it_may_hide() -> None:
    """That something differs and no wheel slips is 0.995: a question, naming the axle whose loss would look
    the same; at 0.97 none."""
    for unusual, wheels in ((0.995, ("fl", "fr")), (0.97, ())):
        questions = Questions(SETTINGS, [0, 1, 2, 3], "front")
        for second in range(200):
            questions.update(found(0.01, unusual), 1.0, float(second), alarm_active=False)
        assert wheels == (questions.open[0].wheels if questions.open else ())
        assert all("trailer" in one.question for one in questions.open)


def test_even_slip_of_driven_wheels_is_asked_about_as_slip() -> None:
    """A drive that even slip explains for certain, or another load: the question names the likelier cause,
    and the axle of which a loss would look the same."""
    for models, cause in (({"evenly low grip": 0.99}, "a slippery road"), ({"a trailer": 0.99}, "trailer")):
        questions = Questions(SETTINGS, [0, 1, 2, 3], "front")
        for second in range(200):
            questions.update(found(0.01, 0.995, **models), 1.0, float(second), alarm_active=False)
        assert ("fl", "fr") == questions.open[0].wheels
        assert cause in questions.open[0].question


@pytest.mark.parametrize(
    ("driven", "of_rear", "axle"),
    [("rear", 0.3, ("rl", "rr")), ("front", 0.3, ("fl", "fr")), ("all", 0.3, ("rl", "rr"))],
)
def test_a_slippery_road_looks_like_soft_tyres_of_a_driven_axle(
    driven: str, of_rear: float, axle: tuple[str, ...]
) -> None:
    """What slips is driven. Where both axles are, the one that looks soft now: what its slip hides is in no
    subset, be the other's 1e-9 or not."""
    judged = found(1e-9, 0.995, **{"evenly low grip": 0.99})
    assert judged.posterior is not None
    possible = np.array([0.0, 0.0, of_rear, of_rear])
    judged = replace(judged, posterior=replace(judged.posterior, possible=possible))
    questions = Questions(SETTINGS, [0, 1, 2, 3], driven)
    for second in range(200):
        questions.update(judged, 1.0, float(second), alarm_active=False)
    assert axle == questions.open[0].wheels


def test_a_tyre_that_may_have_been_soft_before_the_first_start_is_asked_about() -> None:
    """Too little for an alarm and too much for a set of tyres: asked, also after the first minutes, until an
    alarm of a tyre or a reset; what a set has is not."""
    for chance, wheels in ((0.6, ("fr",)), (0.1, ())):
        questions = Questions(SETTINGS, [0, 1, 2, 3], "front")
        for second in range(200):
            questions.update_first_start((1, chance, "2.1 mm smaller"), 1.0)
            questions.update(None, 1.0, float(second), alarm_active=False)
        questions.update(found(0.0), 1.0, 999.0, alarm_active=False)
        assert wheels == (questions.open[0].wheels if questions.open else ())
        assert all("fr is 2.1 mm smaller?" == one.question for one in questions.open)
    questions.close_all()
    assert () == questions.open
