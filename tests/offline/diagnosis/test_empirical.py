"""Physics without a name, from the drive that showed it to the replay that takes it out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.worlds.folder import write_folder
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.config.load import load_config
from tpmsd.car.physics.effects.unknown import Unknown
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import load_model
from tpmsd.foundation.wheels import FL, FR, RL, RR, FloatArray
from tpmsd.interfaces.cli.main import main
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.diagnosis.hypotheses.response import first_hat, smooth_columns, smooth_knots
from tpmsd.offline.diagnosis.selection.empirical import pattern_text
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader


@pytest.fixture(scope="module")
def reader() -> Reader:
    """Five minutes of mixed driving."""
    recording = recording_of(drive(Spec(duration_s=300.0), 6))
    return Reader(recording, reference(recording))


@pytest.mark.parametrize(
    ("pattern", "covariate", "size"),
    [
        ("rear", "speed", 1e-3),
        ("left minus right", "accel_lat", 1e-3),
        ("diagonal", "steering", 1e-3),
        ("fl", "accel_long", 1e-3),
        ("gnss_speed", "accel_long", 0.1),
        ("gnss_course", "accel_lat", 0.02),
        ("yaw_rate", "speed", 0.01),
    ],
)
def test_the_effect_is_the_shape_that_was_fitted(
    reader: Reader, pattern: str, covariate: str, size: float
) -> None:
    """The forward model with the effect moves the channels as the columns of the fit do: by 10 % in all.

    Window by window they differ more, for the mean of a shape is not the shape of a mean.
    """
    knots = {covariate: smooth_knots(reader.windows.covariates)[covariate]}
    columns = smooth_columns(reader, knots)
    on = pattern_text(pattern)
    heights = size * np.maximum(np.arange(len(knots[covariate])) / 2.0 - 1.0, -0.5)
    first = first_hat(on.split()[0].removeprefix("-"))
    heights[:first] = 0.0
    fitted: FloatArray = np.zeros_like(reader.windows.measured)
    for name, column in zip(columns.names, columns.arrays, strict=True):
        sign = 1.0 if name[1] == on or name[1] in on.split() else -1.0 if f"-{name[1]}" in on.split() else 0.0
        if sign:
            fitted += sign * heights[int(name[3]) + first] * column
    effect = Unknown(on, covariate, tuple(knots[covariate]), tuple(heights))
    moved = reader.predict(ExtendedModel((effect,))) - reader.predict(ExtendedModel())

    assert float(np.nanmax(np.abs(fitted))) > 0.5 * size
    assert float(np.nansum(moved * fitted) / np.nansum(fitted**2)) == pytest.approx(1.0, abs=0.1)
    assert float(np.nanstd(moved - fitted)) < 0.3 * float(np.nanstd(fitted))


def test_what_has_no_name_is_compensated_all_the_same(tmp_path: Path) -> None:
    """A rear axle that shrinks around 20 m/s: with the model that diagnose wrote, its radii keep still."""
    dip = {"at_mps": 20.0, "width_mps": 3.0, "wheels": [RL, RR], "size_m": -1.4e-3}
    folder, file = tmp_path / "drive", tmp_path / "model.toml"
    write_folder(drive(Spec(duration_s=600.0, physics={"strange_speed_hump": dip}), 14), folder)
    assert 0 == main(["diagnose", str(folder), "--model-out", str(file)])
    model = load_model(file)
    (effect,) = model.effects
    config = load_config(folder)

    def wander_m(compensated: ExtendedModel | None) -> float:
        """Scatter of the rear radii against the front ones, which the receiver's wander leaves alone."""
        result = replay(folder, config, compensated)
        deviation = result.deviation_m[result.time_s > result.start_s + 120.0]
        return float(np.std(deviation[:, [RL, RR]].mean(axis=1) - deviation[:, [FL, FR]].mean(axis=1)))

    assert ("rl rr", "speed") == (effect.on, effect.covariate) if isinstance(effect, Unknown) else False
    assert len(model.stds[0]["heights"]) == len(effect.values()["heights"])  # type: ignore[arg-type]
    assert wander_m(model) < 0.35 * wander_m(None)
