"""Information matrices that no drive has are refused, by eigenvalues that are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.offline.fleet.result_check import _check_calibration, is_indefinite


@pytest.mark.parametrize("correlation", [0.0, 0.99, 1.0, -1.0])
def test_a_matrix_of_two_is_definite_up_to_full_correlation(correlation: float) -> None:
    """The eigenvalues of [[1, c], [c, 1]] are 1 - c and 1 + c: none is negative."""
    assert not is_indefinite(np.array([[1.0, correlation], [correlation, 1.0]]))


@pytest.mark.parametrize("correlation", [1.01, -1.01, 5.0])
def test_more_than_full_correlation_is_indefinite(correlation: float) -> None:
    """One of the two eigenvalues is negative."""
    assert is_indefinite(np.array([[1.0, correlation], [correlation, 1.0]]))


@pytest.mark.parametrize("value", [5.0, math.inf])
def test_a_result_with_such_a_matrix_is_refused(value: float) -> None:
    """In any units: rows of 1e-6 and 1e6 with a covariance beyond their product, or none that is a number."""
    sound = {"names": ["a", "b"], "information": [1e-12, 0.5, 1e12], "vector": [0.0, 1.0]}
    _check_calibration({"statistics": sound})

    with pytest.raises(ValueError, match="information"):
        _check_calibration({"statistics": {**sound, "information": [1e-12, value, 1e12]}})
