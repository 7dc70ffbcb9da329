"""What was reached and what is left, on data whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.reach import Reach, WhitenedColumns, assess_reach
from tpmsd.offline.diagnosis.hypotheses.terms import Name

WINDOWS, FREE = 900, 30
BLOCKS = np.arange(WINDOWS) // 30
NAMES: list[Name] = [("data",), ("radius", "rl"), ("lateral_slip", "coefficient")]
NAMES += [("smooth", "rl", "speed", str(k)) for k in range(FREE)]


def seen(white: FloatArray, found: bool) -> WhitenedColumns:
    """A drive whose calibration is the constant, and whose model holds the effect if it was found."""
    unit = np.eye(len(NAMES))
    return WhitenedColumns(
        white=white,
        measured=np.ones((WINDOWS, 9), dtype=bool),
        blocks=BLOCKS,
        names=NAMES,
        calibration=unit[:, 1:2],
        model=unit[:, 1:3] if found else unit[:, 1:2],
    )


def examined(size: float, found: bool, seed: int = 1) -> Reach:
    """Data that hold 5 of a constant, 2 of the effect and `size` of the last five free columns."""
    rng = np.random.default_rng(seed)
    white = 0.1 * rng.standard_normal((WINDOWS, 9, len(NAMES)))
    noise = rng.standard_normal((WINDOWS, 9))
    white[:, :, 0] = noise + 5.0 * white[:, :, 1] + 2.0 * white[:, :, 2]
    white[:, :, 0] += size * white[:, :, -5:].sum(axis=2)
    return assess_reach([seen(white, found)])


def expected(size: float) -> float:
    """Log-likelihood that a column of this size is worth: half its squared length."""
    return 0.5 * (size * 0.1) ** 2 * WINDOWS * 9


def test_a_model_that_holds_everything_reaches_everything() -> None:
    """The effect's own gain is found, and the flexible model finds nothing more."""
    answer = examined(0.0, found=True)

    assert answer.found == pytest.approx(expected(2.0), rel=0.15)
    assert (1.0, False) == (pytest.approx(answer.share, abs=0.02), answer.structured)


def test_what_the_model_lacks_is_left() -> None:
    """Five columns of size 1 are worth 202 nats; what shrinkage costs is a small part of it."""
    answer = examined(1.0, found=True)

    assert answer.structured
    assert answer.left == pytest.approx(5 * expected(1.0), rel=0.25)
    assert answer.share == pytest.approx(answer.found / (answer.found + answer.left))


def test_where_there_is_nothing_there_is_no_share() -> None:
    """Without a finding and without structure there is nothing to reach."""
    rng = np.random.default_rng(2)
    white = rng.standard_normal((WINDOWS, 9, len(NAMES)))
    nothing = assess_reach([seen(white, found=False)])

    assert (None, False, 0.0) == (nothing.share, nothing.structured, nothing.found)
    assert abs(nothing.left) < 4.0


def test_an_effect_that_was_not_found_is_left() -> None:
    """The flexible model has the catalogue's columns too."""
    assert examined(0.0, found=False).left == pytest.approx(expected(2.0), rel=0.2)


def test_channels_add_up_and_columns_without_a_trace_do_no_harm() -> None:
    """The channels' gains sum to the whole; a column of zeros changes nothing."""
    answer = examined(1.0, found=True)
    lefts = [channel.left for channel in answer.channels.values()]

    assert answer.left == pytest.approx(sum(lefts))
    assert answer.found == pytest.approx(sum(channel.found for channel in answer.channels.values()))
    assert all(abs(channel.correlation) < 0.06 for channel in answer.channels.values())


def test_what_is_correlated_is_not_white() -> None:
    """Where each window repeats half of the one before, the correlation is a half and whiteness is gone."""
    rng = np.random.default_rng(3)
    white: FloatArray = rng.standard_normal((WINDOWS, 9, len(NAMES)))
    for k in range(1, WINDOWS):
        white[k, :, 0] = 0.5 * white[k - 1, :, 0] + np.sqrt(0.75) * white[k, :, 0]
    white[:, :, 7] = 0.0
    channel = assess_reach([seen(white, found=False)]).channels["yaw_rate"]

    assert channel.correlation == pytest.approx(0.5, abs=0.08)
    assert channel.whiteness < 1e-6


def test_two_drives_share_the_model_and_add_up() -> None:
    """The gain of two like drives is that of both; nothing is left in either."""
    rng = np.random.default_rng(5)
    drives = []
    for _ in range(2):
        white = 0.1 * rng.standard_normal((WINDOWS, 9, len(NAMES)))
        white[:, :, 0] = rng.standard_normal((WINDOWS, 9)) + 2.0 * white[:, :, 2]
        drives.append(seen(white, found=True))
    answer = assess_reach(drives)

    assert answer.found == pytest.approx(2 * expected(2.0), rel=0.25)
    assert not answer.structured
