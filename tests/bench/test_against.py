"""Speed against another commit: the odd log is as odd as it says, and a bar is held or missed."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.against import JITTER_S, ODD_FRACTION, Ratio, odd_log


def test_an_odd_log_loses_repeats_and_swaps(tmp_path: Path) -> None:
    """Of 40,000 frames every 10 ms, each with its number, 0.1 % are lost and as many there twice."""
    (tmp_path / "plain").mkdir()
    frames = [f"({0.01 * number:.6f}) can0 0B0#{number:016X}" for number in range(40_000)]
    (tmp_path / "plain" / "can.log").write_text("\n".join(frames) + "\n")
    odd_log(tmp_path / "plain", tmp_path / "odd")
    lines = (tmp_path / "odd" / "can.log").read_text().splitlines()
    stamps = np.array([float(line[1 : line.index(")")]) for line in lines])
    number = np.array([int(line[-16:], 16) for line in lines])
    times = Counter(number.tolist())
    assert 40_000 - len(times) == pytest.approx(ODD_FRACTION * 40_000, abs=20)
    assert sum(1 for count in times.values() if count == 2) == pytest.approx(ODD_FRACTION * 40_000, abs=20)
    assert np.count_nonzero(np.diff(number) < 0) == pytest.approx(ODD_FRACTION * 40_000, abs=20)
    assert (stamps - 0.01 * number).std() == pytest.approx(JITTER_S, rel=0.05)
    assert (np.diff(stamps) >= 0.0).all()


def test_a_bar_is_held_or_missed() -> None:
    """Of both commits the ratio counts; of this one alone the value, from above or from below."""
    assert Ratio("replay", "s", 2.0, 8.0, 4.0, 3.9, 4.1, bar=4.0).held
    assert not Ratio("replay", "s", 2.0, 7.8, 3.9, 3.9, 4.1, bar=4.0).held
    assert not Ratio("daemon", "MB", 61.0, None, None, None, None, bar=60.0).held
    two = Ratio("fleet", "x", 1.9, None, None, None, None, bar=1.85, at_least=True)
    assert two.held
    assert two.line().endswith("bar: at least 1.85, held")
