"""The prediction from the inputs alone: that of the steps one by one, at the limit too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from tests.offline.dynamics.test_baselines import CAR
from tpmsd.car.physics.baselines.base import Theta
from tpmsd.car.physics.baselines.inputs import Span, make_inputs
from tpmsd.car.physics.baselines.three_dof import ThreeDof
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics import predict
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.path import Linear, Setup, linear


def test_blocks_that_slide_are_solved_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second half slides by 9 m/s: its blocks take rounds in which the others have no part, and none is
    driven step by step."""
    time_s = np.arange(0.0, 40.0, 0.02)
    steer = np.where(time_s < 20.0, 0.01, 0.12) * np.sin(1.5 * time_s)
    u = make_inputs(time_s, steer, np.full(len(time_s), 30.0), np.zeros(len(time_s)))
    model, drive = ThreeDof(CAR), DynamicsDrive("slides", u, {})
    asked: list[int] = []

    def counted(setup: Setup, theta: Theta, path: FloatArray, **options: object) -> Linear:
        asked.append(len(setup.drive.starts))
        return linear(setup, theta, path, **options)  # type: ignore[arg-type]

    def refused(*_: Sequence[object]) -> FloatArray:
        raise AssertionError

    monkeypatch.setattr(predict, "linear", counted)
    monkeypatch.setattr(predict, "_step_all_blocks", refused)
    begin = np.zeros((len(time_s), 2))
    begin[drive.starts, 1] = 0.01 * np.arange(len(drive.starts))
    kicks = np.zeros((len(time_s) - 1, 2))
    kicks[:, 1] = 1e-4 * np.sin(time_s[1:])

    found = predict.free_run(Setup(model, drive, ()), (), begin, kicks=kicks)

    wanted = begin.copy()
    for k in range(int(np.max(drive.ends - drive.starts)) - 1):
        rows = drive.starts[drive.starts + k + 1 < drive.ends] + k
        span = Span(u.take(rows), u.take(rows + 1))
        wanted[rows + 1] = model.step(wanted[rows], span, (), 0.02) + kicks[rows]
    assert float(np.max(np.abs(wanted[:, 0]))) > 5.0
    assert found == pytest.approx(wanted, abs=1e-5)
    assert asked[0] == len(drive.starts) > 2 * asked[-1]
    assert len(asked) > 12
