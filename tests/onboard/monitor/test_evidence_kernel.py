"""The comparison of hypotheses: compiled code and NumPy arrays give the same."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from tpmsd.foundation.kernels import kernels
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.first_start import first_by_arrays, first_by_compiled
from tpmsd.onboard.monitor.evidence.hypotheses import Comparison, Table, Verdict
from tpmsd.onboard.monitor.evidence.nuisance import squares_by_arrays, squares_by_compiled
from tpmsd.onboard.monitor.evidence.posterior import Posterior, Window, by_arrays, by_compiled
from tpmsd.onboard.monitor.evidence.sizes import (
    SizeHypotheses,
    TyreSizeChange,
    size_rows,
    unchanged_sizes,
    with_sizes,
    with_sizes_by_arrays,
    with_sizes_by_compiled,
)

SAME = 1e-9
"""Relative: both round alike but for the order of sums and the way in which a matrix is solved."""
WHEELS = ((2, 3), (0, 1, 2), (0, 1, 2, 3))


@pytest.fixture(autouse=True)
def built() -> None:
    """Nothing can be compared where nothing was compiled."""
    if not kernels()["evidence"]:
        pytest.skip("the compiled kernel is not built here (no compiler, or no headers of Python)")


def some_changes(
    wheels: tuple[int, ...], count: int, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Changes of some tenths of a millimetre, known to a tenth or two; their weights; radii."""
    rng = np.random.default_rng(seed)
    d = len(wheels)
    root = rng.standard_normal((count, d, d)) * 1e-4
    covariance = root @ root.transpose(0, 2, 1) + 1e-8 * np.eye(d)
    change = rng.standard_normal((count, d)) * rng.choice([2e-4, 3e-3])
    return change, covariance, rng.uniform(-20.0, 0.0, count), rng.uniform(0.3, 0.33, d)


def assert_sized_alike(one: SizeHypotheses, other: SizeHypotheses) -> None:
    """Equal but for rounding."""
    for part in fields(SizeHypotheses):
        np.testing.assert_allclose(getattr(other, part.name), getattr(one, part.name), rtol=SAME, atol=1e-12)


def assert_alike(one: Verdict, other: Verdict) -> None:
    """Equal but for rounding, tables of logarithms included."""
    for part in fields(Verdict):
        ours, theirs = getattr(one, part.name), getattr(other, part.name)
        if isinstance(ours, Table):
            for column in fields(Table):
                pair = getattr(ours, column.name), getattr(theirs, column.name)
                np.testing.assert_allclose(pair[1], pair[0], rtol=SAME, atol=SAME, err_msg=column.name)
        else:
            np.testing.assert_allclose(theirs, ours, rtol=SAME, atol=1e-13, err_msg=part.name)


@pytest.mark.parametrize("wheels", WHEELS)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("every", [False, True])
def test_changes_under_sizes_are_alike(wheels: tuple[int, ...], seed: int, every: bool) -> None:
    """Rows that count are the same ones, in the same order."""
    given = some_changes(wheels, 1 + seed, seed)
    for sizes in (size_rows(wheels), unchanged_sizes(len(wheels))):
        found = with_sizes_by_compiled(*given, sizes, every=every)
        assert found is not None
        assert_sized_alike(with_sizes_by_arrays(*given, sizes, every=every), found)


@pytest.mark.parametrize("wheels", WHEELS)
@pytest.mark.parametrize("seed", range(6))
def test_verdicts_are_alike(wheels: tuple[int, ...], seed: int) -> None:
    """One change and many, with resonances and without, of other tyres, with a limit of deviation; changes of
    which one is impossible."""
    change, covariance, weight, radius = some_changes(wheels, 1 + 2 * seed, seed)
    sizes: TyreSizeChange | None = size_rows(wheels)
    given = with_sizes(change, covariance, weight, radius, size_rows(wheels))
    ratios = np.random.default_rng(seed).standard_normal(2 ** len(wheels) - 1)
    options = (None, ratios)[seed % 2], seed == 3
    if seed == 5:
        sizes, given = None, SizeHypotheses.as_learned(change, covariance, weight)
        given = replace(given, log_weight=np.where(np.arange(weight.size) == 2, -np.inf, weight))
    for limit in (math.inf, 0.02):
        against = Comparison(radius, 0.006, *options, sizes, limit)
        found = against.by_compiled(given)
        assert found is not None
        assert_alike(against.by_arrays(given), found)


def test_a_covariance_that_is_none_is_left_to_arrays() -> None:
    """Compiled code factorises; it declines a matrix that has no factor."""
    change, covariance, weight, radius = some_changes((0, 1, 2, 3), 2, 1)
    covariance[1, 2, 2] = -1.0
    assert with_sizes_by_compiled(change, covariance, weight, radius, unchanged_sizes(4)) is None
    assert (
        Comparison(radius, 0.006).by_compiled(SizeHypotheses.as_learned(change, covariance, weight)) is None
    )


def test_arrays_that_do_not_belong_together_are_declined() -> None:
    """A row that is not among the sizes would be read from beyond the table."""
    change, covariance, weight, radius = some_changes((0, 1, 2, 3), 2, 1)
    given = replace(SizeHypotheses.as_learned(change, covariance, weight), row=np.array([0, 9]))
    with pytest.raises(ValueError, match="belong together"):
        Comparison(radius, 0.006).by_compiled(given)
    with pytest.raises(ValueError, match="belong together"):
        with_sizes_by_compiled(change, covariance, weight[:1], radius, unchanged_sizes(4))


def some_windows(wheels: tuple[int, ...], count: int, seed: int, *, sized: bool) -> list[Window]:
    """Windows of which the young ones know sizes that came in them; the probability of subsets scatters from
    none to all of it."""
    rng = np.random.default_rng(seed)
    windows = []
    for over in ("now", "minutes", "drive")[:count]:
        change, covariance, weight, radius = some_changes(wheels, 2, seed)
        every = size_rows(wheels) if sized else unchanged_sizes(len(wheels))
        sizes = every
        if over == "now" and sized:
            sizes = every.rows_of_window(
                with_sizes(change, covariance, weight, radius, every, every=True), 0.3
            )
        judged = Comparison(radius, 0.006, None, False, sizes, 0.02).compare_hypotheses(
            with_sizes(change, covariance, weight, radius, sizes)
        )
        believed = rng.choice([0.0, 0.4, 1.0], (judged.table.lost.shape[1], len(wheels)))
        off = believed if over == "drive" else rng.choice([0.0, 1.0], believed.shape)
        windows.append(Window(over, judged, believed, off, sizes.came))  # type: ignore[arg-type]
    return windows


@pytest.mark.parametrize("wheels", WHEELS)
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("sized", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_posteriors_are_alike(wheels: tuple[int, ...], count: int, sized: bool, seed: int) -> None:
    """Every marginal of one window and of several, with sizes that came in a window and without any size."""
    windows = some_windows(wheels, count, seed, sized=sized)
    reference, found = by_arrays(windows), by_compiled(windows)
    assert found is not None
    for part in fields(Posterior):
        ours, theirs = getattr(reference, part.name), getattr(found, part.name)
        if isinstance(ours, dict):
            assert theirs == pytest.approx(ours, rel=SAME, abs=1e-13)
        else:
            np.testing.assert_allclose(theirs, ours, rtol=SAME, atol=1e-13, err_msg=part.name)


def test_windows_of_different_sizes_are_left_to_arrays() -> None:
    """Their rows do not belong to the same wheels."""
    windows = [*some_windows((0, 1, 2, 3), 1, 1, sized=False), *some_windows((0, 1, 2, 3), 1, 1, sized=True)]
    assert by_compiled(windows) is None


def test_windows_of_different_wheels_are_declined() -> None:
    """They would be read from beyond their probability."""
    windows = [*some_windows((2, 3), 1, 1, sized=False), *some_windows((0, 1, 2, 3), 1, 1, sized=False)]
    with pytest.raises(ValueError, match="belong together"):
        by_compiled(windows)


@pytest.mark.parametrize("wheels", WHEELS)
@pytest.mark.parametrize("seed", range(3))
def test_squares_and_volumes_are_alike(wheels: tuple[int, ...], seed: int) -> None:
    """Mahalanobis distances and determinants of several changes, and of one change under each covariance."""
    change, covariance, _, _ = some_changes(wheels, 1 + 4 * seed, seed)
    for values in (change, np.broadcast_to(change[0], change.shape)):
        found = squares_by_compiled(values, covariance)
        assert found is not None
        for ours, theirs in zip(squares_by_arrays(values, covariance), found, strict=True):
            np.testing.assert_allclose(theirs, ours, rtol=SAME)


def test_squares_of_no_covariance_are_left_to_arrays() -> None:
    """As a comparison of it is."""
    change, covariance, _, _ = some_changes((0, 1, 2, 3), 2, 1)
    covariance[1, 2, 2] = -1.0
    assert squares_by_compiled(change, covariance) is None
    with pytest.raises(ValueError, match="belong together"):
        squares_by_compiled(change[:1], covariance)


@pytest.mark.parametrize("wheels", WHEELS)
@pytest.mark.parametrize("seed", range(6))
def test_first_radii_are_judged_alike(wheels: tuple[int, ...], seed: int) -> None:
    """Wheels that are alike, and one that is 2 % smaller or larger than the others."""
    change, covariance, _, radius = some_changes(wheels, 1, seed)
    x, noise = change[0] / radius, covariance[0] / np.outer(radius, radius)
    x[seed % len(wheels)] += (0.0, -0.02, 0.02)[seed % 3]
    found = first_by_compiled(x, noise, list(wheels))
    assert found is not None
    for ours, theirs in zip(first_by_arrays(x, noise, list(wheels)), found, strict=True):
        np.testing.assert_allclose(theirs, ours, rtol=SAME, atol=1e-13)


def test_first_radii_known_by_no_covariance_are_left_to_arrays() -> None:
    """A variance below zero has no factor, however wide the prior."""
    change, covariance, _, radius = some_changes((0, 1, 2, 3), 1, 1)
    covariance[0, 2, 2] = -1.0
    noise = covariance[0] / np.outer(radius, radius)
    assert first_by_compiled(change[0] / radius, noise, [0, 1, 2, 3]) is None
    with pytest.raises(ValueError, match="belong together"):
        first_by_compiled(change[0] / radius, noise[:3, :3].copy(), [0, 1, 2, 3])
