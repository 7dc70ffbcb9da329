"""A state file whose checksum holds and whose numbers lie: refused at restore, and learning begins again."""

from __future__ import annotations

import copy
import functools
import json
import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cantools.database import Database
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.faults.drives import drive, played
from tpmsd.car.config.model import Config
from tpmsd.foundation.bounds import check_like, check_plain, covariance, no_wider, number
from tpmsd.onboard.daemon.state_keeper import StateKeeper, fingerprint
from tpmsd.onboard.estimators.base import NIGHT_S, RadiusEstimate, unsound_reason
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sinks.state_file import save_state
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.timeline.tick import Tick

HOSTILE: list[Any] = [
    *(math.nan, math.inf, -math.inf, 1e308, -1e308, 1e13, -1e13),
    *(10**400, -(10**400), "1", None, [], {}, [[1.0]]),
]
LOG = logging.getLogger("tests.hostile")
LATE_S = 100.0


@functools.cache
def learned() -> tuple[Config, dict[str, Any]]:
    """A configuration, and what was learned before something happens to the drive."""
    config, _ = drive()
    outcome = played(lambda items, start_s: [i for i in items if i.time_s < start_s + LATE_S])
    assert outcome.pipeline is not None
    return config, json.loads(json.dumps(outcome.pipeline.snapshot()))


@functools.cache
def database() -> Database:
    return load_database(learned()[0].can.dbc)


def fresh() -> Pipeline:
    return Pipeline(learned()[0], database())


def leaves(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths to everything that is neither a list nor an object."""
    if isinstance(value, dict):
        return [found for key, inner in value.items() for found in leaves(inner, (*path, key))]
    if isinstance(value, list):
        return [found for k, inner in enumerate(value) for found in leaves(inner, (*path, k))]
    return [path]


def changed(saved: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    out = copy.deepcopy(saved)
    place: Any = out
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return out


def test_what_was_saved_is_taken_up() -> None:
    """The bounds hold what a drive truly taught, and so do they after three hundred restarts."""
    _, saved = learned()
    pipeline = fresh()
    for _ in range(300):
        pipeline.restore(saved)
        saved = json.loads(json.dumps(pipeline.snapshot()))
    assert saved["monitor"]["sets"]["baseline"]["ready"]
    assert np.max(np.diag(saved["estimator"]["covariance_m2"])) <= 1.01 * 0.00316**2


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=150)
def test_any_number_in_the_state_has_bounds(data: st.DataObject) -> None:
    """Whatever stands in the place of a number is refused with ValueError, or is within what a car may have;
    in both cases the pipeline goes on with numbers."""
    _, saved = learned()
    path = data.draw(st.sampled_from(leaves(saved)))
    value = data.draw(st.sampled_from(HOSTILE))
    pipeline = fresh()
    try:
        pipeline.restore(changed(saved, path, value))
    except ValueError:
        return
    is_text = isinstance(value, str | list | dict) or value is None
    assert is_text, f"{path} took up {value!r}"
    check_plain(pipeline.snapshot())


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=60)
def test_a_covariance_in_the_state_must_be_one(data: st.DataObject) -> None:
    """A variance a thousand times the prior, one below zero and a covariance beyond them are refused."""
    _, saved = learned()
    matrices = [
        ("estimator", "covariance_m2"),
        ("estimator", "nuisance_covariance"),
        ("monitor", "sets", "baseline", "reference", "covariance"),
    ]
    path = data.draw(st.sampled_from(matrices))
    matrix: Any = functools.reduce(lambda place, key: place[key], path, saved)
    row, column = data.draw(st.integers(0, len(matrix) - 1)), data.draw(st.integers(0, len(matrix) - 1))
    worst = max(abs(x) for line in matrix for x in line)
    value = data.draw(st.sampled_from([1e4 * worst + 1.0, -1e4 * worst - 1.0]))
    with pytest.raises(ValueError, match="saved"):
        fresh().restore(changed(saved, (*path, row, column), value))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("estimator", "nuisance_covariance", 0, 0), 1e308),
        (("estimator", "informative_s"), 10**400),
        (("monitor", "sets", "baseline", "learned_s"), 10**400),
        (("monitor", "sets", "baseline", "reference", "mean", 0), math.nan),
    ],
)
def test_a_hostile_state_is_set_aside_with_one_line_and_does_not_come_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, path: tuple[Any, ...], value: Any
) -> None:
    """The checksum is right and a number is not: one warning, the file is moved away, the next start is
    quiet, and the puncture is found."""
    config, saved = learned()
    config = replace(config, state=replace(config.state, file=tmp_path / "state.json"))
    assert config.state.file is not None
    save_state(
        config.state.file, {"fingerprint": fingerprint(config), "pipeline": changed(saved, path, value)}
    )
    StateKeeper(config, LOG).restored(lambda: Pipeline(config, database()))
    assert 1 == len(caplog.messages)
    assert "does not fit" in caplog.messages[0]
    assert "set aside as state.json.other" in caplog.messages[0]
    assert len(caplog.messages[0]) < 400
    caplog.clear()
    StateKeeper(config, LOG).restored(lambda: Pipeline(config, database()))
    assert [] == caplog.messages
    assert ["state.json.other"] == [file.name for file in tmp_path.iterdir()]


class Broken:
    """An estimator that gives what is no number, or breaks, from one tick on."""

    def __init__(self, inner: Any, from_tick: int, how: str) -> None:
        self._inner, self._from, self._how = inner, from_tick, how
        self._ticks = 0

    def snapshot(self) -> dict[str, Any]:
        saved: dict[str, Any] = self._inner.snapshot()
        return saved

    def restore(self, saved: dict[str, Any], since_s: float = NIGHT_S) -> None:
        self._inner.restore(saved, since_s)

    def step(self, tick: Tick) -> RadiusEstimate:
        self._ticks += 1
        estimate: RadiusEstimate = self._inner.step(tick)
        if self._ticks < self._from:
            return estimate
        if self._how == "raises":
            raise np.linalg.LinAlgError("not positive definite")
        spread = estimate.covariance_m2.copy()
        spread[3, 0] = math.inf
        return estimate._replace(covariance_m2=spread)


@pytest.mark.parametrize("how", ["covariance", "raises"])
def test_an_estimate_that_is_no_number_is_a_malfunction_and_a_new_start(how: str) -> None:
    """A covariance that is not finite, or an estimator that breaks: `malfunction` in that very tick, a new
    estimator, and the puncture forty seconds later is found."""
    config, items = drive()
    pipeline = Pipeline(config, load_database(config.can.dbc))
    pipeline.estimator.inner = Broken(pipeline.estimator.inner, 650, how)
    said, numbers = [], []
    for item in items:
        if isinstance(item, CanFrame):
            steps = pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            steps = pipeline.on_sentence(item.time_s, item.line)
        for step in steps:
            numbers.append(bool(np.all(np.isfinite(step.estimate.deviation_m))))
            said += [(str(e.kind), e.wheel, e.state) for e in step.report.events]
    assert all(numbers)
    assert ("malfunction", None, "raised") == said[0]
    assert ("malfunction", None, "cleared") in said
    assert ("deflation", "rl", "raised") in said


def test_what_is_no_estimate_is_distinguished_from_one() -> None:
    """Wheels that are not estimated may be unknown; the others must be numbers, near and with a variance."""
    outcome = played(lambda items, start_s: [i for i in items if i.time_s < start_s + 5.0])
    estimate = outcome.steps[-1].estimate
    assert "" == unsound_reason(estimate, [0, 1, 2, 3])
    for value, reason in (
        (math.nan, "a radius is not a number"),
        (0.21, "a radius is off by more than 0.2 m"),
    ):
        deviation = estimate.deviation_m.copy()
        deviation[1] = value
        assert reason == unsound_reason(estimate._replace(deviation_m=deviation), [0, 1, 2, 3])
        assert "" == unsound_reason(estimate._replace(deviation_m=deviation), [0, 2, 3])
    spread = estimate.covariance_m2.copy()
    spread[2, 2] = -1e-12
    assert "a variance is negative" == unsound_reason(estimate._replace(covariance_m2=spread), [0, 1, 2, 3])


def test_bounds_refuse_what_is_beyond_them() -> None:
    """Closed forms: limits are inclusive, a covariance must be symmetric and of limited variance."""
    assert 2.0 == number(2, 1.0, 2.0)
    for bad in (2.1, True, "1", None, math.nan):
        with pytest.raises(ValueError, match="saved"):
            number(bad, 1.0, 2.0)
    most = np.array([4.0, 1.0])
    assert [[4.0, 1.9], [1.9, 1.0]] == covariance([[4.0, 1.9], [1.9, 1.0]], most).tolist()
    for matrix in ([[4.0, 2.1], [2.1, 1.0]], [[4.1, 0.0], [0.0, 1.0]], [[4.0, 0.1], [0.0, 1.0]], [[4.0]]):
        with pytest.raises(ValueError, match="saved"):
            covariance(matrix, most)
    wide = np.array([[16.0, 4.0], [4.0, 1.0]])
    assert [[4.0, 2.0], [2.0, 1.0]] == no_wider(wide, most).tolist()
    prior = {"a_covariance": [[1.0]], "a": [0.0]}
    check_like({"a_covariance": [[25.0]], "a": [50.0]}, prior)
    for saved in ({"a_covariance": [[26.0]], "a": [0.0]}, {"a_covariance": [[1.0]], "a": [51.0]}, {}):
        with pytest.raises(ValueError, match="saved"):
            check_like(saved, prior)
