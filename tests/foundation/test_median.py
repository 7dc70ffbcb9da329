"""Medians without masked arrays."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tpmsd.foundation.median import median


@pytest.mark.parametrize("count", [1, 2, 7, 20])
def test_it_is_numpys_to_the_last_bit(count: int) -> None:
    """Odd and even counts, numbers and rows of them."""
    rows = np.random.default_rng(count).standard_normal((count, 3))
    assert np.array_equal(np.median(rows, axis=0), median(rows))
    assert np.median(rows[:, 0]) == float(median(rows[:, 0]))


def test_no_masked_arrays_are_imported() -> None:
    """NumPy's own median imports them."""
    code = "import sys, numpy as np\nfrom tpmsd.foundation.median import median\nmedian(np.arange(3.0))\n"
    code += "print('numpy.ma' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "False" == done.stdout.strip()
