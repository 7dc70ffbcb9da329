"""Least squares over drives."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.offline.inference.fit import gram, solved


def test_drives_with_a_key_in_common_are_one_regression() -> None:
    """Two drives with a shared and an own value each, and a prior, equal one stacked least squares."""
    rng = np.random.default_rng(2)
    A, B = rng.standard_normal((30, 2)), rng.standard_normal((40, 2))
    a, b = rng.standard_normal((30, 3)), rng.standard_normal((40, 3))
    found = solved([gram(("x", "p"), a, A), gram(("q", "x"), b, B)], {"q": (0.5, 0.1)})
    rows = np.zeros((71, 3))
    rows[:30, :2], rows[30:70, [2, 0]], rows[70, 2] = A, B, 10.0
    y = np.concatenate([a, b, np.full((1, 3), 5.0)])
    expected, misfit, *_ = np.linalg.lstsq(rows, y, rcond=None)

    assert ("x", "p", "q") == found.keys
    assert found.values == pytest.approx(expected)
    assert found.covariance == pytest.approx(np.linalg.inv(rows.T @ rows))
    assert found.log_likelihood == pytest.approx(-0.5 * (misfit + 2.0 * np.log(0.1)))


def test_what_no_drive_tells_is_refused() -> None:
    """A column of nothing, and two that are one, raise with their keys."""
    X = np.ones((5, 1))
    y = np.arange(5.0)[:, None]

    with pytest.raises(ValueError, match="nothing tells b"):
        solved([gram(("a", "b"), y, np.hstack([X, 0.0 * X]))], {})
    with pytest.raises(ValueError, match="do not tell a b apart"):
        solved([gram(("a", "b"), y, np.hstack([X, X]))], {})
