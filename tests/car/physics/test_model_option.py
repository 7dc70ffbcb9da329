"""`--model` on the command line: shapes are played and taken out, and what stays is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from tpmsd.interfaces.cli.main import main

SHAPE = """[[effect]]
name = "unknown"
on = "rl -rr"
covariate = "{covariate}"
knots = [{knots}]
heights = [0.0, 0.001]
"""
LEAK = """[[effect]]
name = "radius_change"
wheel = "fl"
deviation_m = -0.002
"""


@pytest.mark.parametrize(
    ("covariate", "knots", "reason"),
    [
        ("speed", "20, 10", "knots[1] = 10 does not lie above knots[0] = 20"),
        ("speed", "10, 20, 30", "3 knots, but 2 heights"),
        ("speed", "10, nan", "knots[1] = nan is not a finite number"),
        (
            "pressure",
            "10, 20",
            "covariate = 'pressure' is not one of speed accel_long accel_lat yaw_rate steering steering_rate "
            "grade time distance temperature torque",
        ),
    ],
)
def test_a_shape_that_is_none_is_one_line_and_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], covariate: str, knots: str, reason: str
) -> None:
    """File and reason, nothing else."""
    file = tmp_path / "model.toml"
    file.write_text(SHAPE.format(covariate=covariate, knots=knots), encoding="utf-8")

    assert 2 == main(["simulate", str(tmp_path / "drive"), "--model", str(file)])
    assert f"tpmsd: {file}: effect unknown: {reason}\n" == capsys.readouterr().err


def test_replay_says_what_it_does_not_compensate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The fault, a shape over time, one over a temperature that is not on the bus; the rest is quiet."""
    shapes = [SHAPE.format(covariate=name, knots="0, 40") for name in ("speed", "time", "temperature")]
    file = tmp_path / "model.toml"
    file.write_text("\n".join([LEAK, *shapes]), encoding="utf-8")
    drive = str(tmp_path / "drive")
    assert 0 == main(["simulate", drive, "--duration", "30", "--bus", "speeds", "--model", str(file)])
    capsys.readouterr()

    assert 0 == main(["replay", drive, "--model", str(file)])
    start = f"tpmsd: {file}: "
    said = [line for line in capsys.readouterr().err.splitlines() if "compensated" in line]
    assert [
        f"{start}radius_change is not compensated: the radius of fl is what is watched, and its change the "
        "fault itself",
        f"{start}unknown is not compensated: a shape over time belongs to the drive on which it was found",
        f"{start}unknown is not compensated: it depends on temperature, and the bus has no ambient_temp",
    ] == said
