"""Effects of vehicle dynamics that users bring: taken in, checked, refused with one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
from tpmsd.car.physics.own_dynamics import checked_effect, external_dynamics_effects
from tpmsd.car.physics.own_effects import VARIABLE, dynamics_classes_of, effects_of_file, module_of_file
from tpmsd.foundation.errors import ConfigError

GOOD = """
from dataclasses import dataclass
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.parameters import Parameter, Prior

@dataclass(frozen=True)
class Pull(DynamicsEffect):
    name = "crooked_pull"
    sentence = "the car pulls to one side"
    formula = "F_y = coefficient * m * u"
    parameters = (Parameter("coefficient", "1/s", {typical}, -1.0, 1.0, probe=1e-4, prior={prior}),)
    coefficient: float = 0.0

    def add_forces(self, frame):
        frame.force_y = frame.force_y + self.coefficient * frame.mass * {factor}
"""
TYPICAL = {"typical": "0.01", "prior": 'Prior(0.0, 0.02, "none")', "factor": "frame.u"}


def written(folder: Path, **changes: str) -> Path:
    """Write the file of an effect."""
    path = folder / "pull.py"
    path.write_text(GOOD.format(**{**TYPICAL, **changes}))
    folder.chmod(0o755)
    path.chmod(0o644)
    return path


def test_a_file_brings_an_effect_of_vehicle_dynamics_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rolling wheels get nothing of it and take no offence; the dynamics get the class once."""
    path = written(tmp_path)
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    (found,) = external_dynamics_effects(DYNAMICS_EFFECTS)

    assert effects_of_file(path) == []
    assert found.name == "crooked_pull"
    assert [found] == dynamics_classes_of(module_of_file(path))
    assert [] == list(external_dynamics_effects({**DYNAMICS_EFFECTS, "crooked_pull": found}))


def test_a_name_that_is_taken_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line with the file and the other's module."""
    written(tmp_path)
    monkeypatch.setenv(VARIABLE, str(tmp_path))

    with pytest.raises(ConfigError, match=r"another effect 'crooked_pull'"):
        list(external_dynamics_effects({"crooked_pull": DYNAMICS_EFFECTS["mass_error"]}))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"prior": "None"}, "prior"),
        ({"factor": "float('nan')"}, "no finite"),
        ({"factor": "frame.nothing"}, "nothing"),
    ],
)
def test_a_broken_effect_is_one_line(tmp_path: Path, changes: dict[str, str], said: str) -> None:
    """Without a prior, with a NaN, with an error."""
    (effect,) = dynamics_classes_of(module_of_file(written(tmp_path, **changes)))

    with pytest.raises(ConfigError, match=said) as error:
        checked_effect(effect, "pull.py")
    assert "\n" not in str(error.value)
