"""Figures 3 to 10 come of the rows of the runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from bench.campaigns.onboard.estimators.figures import draw_paper
from bench.campaigns.onboard.estimators.methods import POSITIONS, SAMPLED, WANTED
from bench.campaigns.onboard.estimators.tasks import NUMBERS, USUAL
from bench.worlds.paper_drive import SCENARIOS

LINES = ("difference_mm", "truth_mm", "left_mm", "right_mm", "left_noise_mm", "right_noise_mm")


def run(scenario: str, method: str, particles: int) -> dict[str, Any]:
    """A run of the white receiver by positions; its series has as many points for each line."""
    some = [0.1 * math.sin(k / 5.0) for k in range(60)]
    series = {**dict.fromkeys(LINES, some), "east_m": some, "north_m": some}
    return {
        "scenario": scenario,
        "receiver": "white",
        "seed": 0,
        "method": method,
        "particles": particles,
        "front": False,
        "inputs": POSITIONS,
        "rmse_difference_m": 1e-4 * (1 + particles % 7),
        "diverged": "place lost" if particles == NUMBERS[0] else "",
        **({"series": series} if particles in (0, USUAL) else {}),
    }


def test_figures_3_to_10_are_drawn(tmp_path: Path) -> None:
    """One file for each, and the same bytes for the same rows."""
    rows = [
        run(scenario, method, particles)
        for scenario in SCENARIOS
        for method in WANTED
        for particles in (NUMBERS if method in SAMPLED else (0,))
    ]
    drawn = draw_paper({"rows": rows}, tmp_path / "one")
    assert [f"paper-fig{number}.svg" for number in range(3, 11)] == [path.name for path in drawn]
    again = draw_paper({"rows": rows}, tmp_path / "two")
    assert [path.read_bytes() for path in drawn] == [path.read_bytes() for path in again]
