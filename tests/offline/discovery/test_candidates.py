"""Candidates for wheels on drives that turn little: sides by the receiver, and probabilities that hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.discovery.candidates import Candidate, candidates
from tpmsd.offline.discovery.reference import ReceiverMotion
from tpmsd.offline.discovery.series import MessageField, Series
from tpmsd.offline.discovery.wheels import Follower
from tpmsd.onboard.sources.can.signal_plan import BitField

TRACK_M, WHEELBASE_M, CELLS, CELL_S = 1.54, 2.7, 120, 0.5
PLACES = ((1, 1), (-1, 1), (1, 0), (-1, 0))
"""Left (1) or right (-1), front (1) or rear (0), of fl, fr, rl and rr."""


def place(number: int) -> BitField:
    return BitField(
        big_endian=False,
        min_bytes=2 * (number + 1),
        length=16,
        shift=16 * number,
        word_bytes=8,
        signed=False,
        is_float=False,
        mask=0xFFFF,
    )


def drive(seed: int, turning_radps: float) -> tuple[list[Follower], ReceiverMotion]:
    """A minute at 10 to 20 m/s: four wheels in one message, the car's speed in another; a noisy yaw rate."""
    rng = np.random.default_rng(seed)
    time_s: FloatArray = np.asarray(CELL_S * np.arange(CELLS))
    speed = 15.0 + 5.0 * np.sin(0.1 * time_s + seed)
    yaw = turning_radps * np.convolve(rng.standard_normal(CELLS + 8), np.ones(9) / 3.0, "valid")
    reference = ReceiverMotion(
        edge_s=CELL_S * np.arange(CELLS + 1.0),
        speed_mps=speed + 0.02 * rng.standard_normal(CELLS),
        yaw_radps=yaw + 0.01 * rng.standard_normal(CELLS),
        accel_mps2=np.gradient(speed, CELL_S),
        fix_s=time_s,
        fix_speed_mps=speed,
        fix_course_rad=np.cumsum(yaw) * CELL_S,
        by_position=False,
    )
    found = []
    for number, (side, front) in enumerate(PLACES):
        own = speed - side * 0.5 * TRACK_M * yaw + front * (WHEELBASE_M * yaw) ** 2 / (2.0 * speed)
        found.append(_follower("ID_0AA", f"I{16 * number}_16", 1, number, own, rng))
    found.append(_follower("ID_0B4", "I0_16", 2, 0, speed, rng))
    return found, reference


def _follower(
    message: str, name: str, key: int, number: int, speed: FloatArray, rng: np.random.Generator
) -> Follower:
    noisy = speed + 0.003 * rng.standard_normal(len(speed))
    series = Series(MessageField(message, name, key, place(number)), "value", 100.0 * noisy)
    return Follower(series, 100.0, 0.0, 0.999, speed=noisy)


def by_signal(made: tuple[Candidate, ...]) -> dict[str, Candidate]:
    return {one.field.signal: one for one in made}


def test_sides_are_reported_with_probabilities_that_hold() -> None:
    """Over sixty drives of little turning the sides are right as often as claimed, to three deviations."""
    claimed, right = [], []
    for seed in range(60):
        found, reference = drive(seed, 0.004)
        made = by_signal(candidates(found, reference))
        one = made.get("ID_0AA.I0_16")
        if one is not None and one.any_wheel > 0.5:
            claimed.append(one.probability / one.any_wheel)
            right.append(one.side == "left")
    assert len(right) > 20
    share, expected = float(np.mean(right)), float(np.mean(claimed))
    assert share > expected - 3.0 * np.sqrt(0.25 / len(right))


def test_the_four_of_one_message_are_the_wheels() -> None:
    """With some turning all four are named on their sides, and the car's own speed is not among them."""
    found, reference = drive(1, 0.02)
    made = candidates(found, reference)

    sides = {one.field.signal: one.side for one in made[:4]}
    assert {f"ID_0AA.I{16 * k}_16": ("left", "right")[k % 2] for k in range(4)} == sides
    assert min(one.any_wheel for one in made[:4]) > 0.9
    assert max((one.any_wheel for one in made[4:]), default=0.0) < 0.2


def test_a_recorded_minute_without_a_dbc(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The four wheel speeds of a recorded minute: left and right ones as the car's DBC has them, exit 4."""
    assert 4 == main(["discover", str(recordings / "rav4-suburb-60s"), "--no-dbc"])
    text = capsys.readouterr().out
    assert "can.signals.wheel_speed_rl: " in text
    reported = [line.split() for line in text.splitlines() if "a wheel's speed" in line]

    found = {words[0].rstrip(":").removeprefix("ID_0AA."): words for words in reported}
    # WHEEL_SPEEDS of bus.dbc: FR at bit 7, FL at 23, RR at 39, RL at 55.
    expected = {"M7_16": "right", "M23_16": "left", "M39_16": "right", "M55_16": "left"}
    assert expected == {name: found[name][-2] for name in expected}
    assert min(float(found[name][4].rstrip(",")) for name in ("M23_16", "M39_16", "M55_16")) > 0.7
