"""The words in which a found effect is told, with its numbers in them."""

from __future__ import annotations

import string

import pytest

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.effect import Parameter
from tpmsd.car.physics.in_words import FoundValue, clause, found_value, noun, rounded


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("yaw_rate_scale", {"scale": (0.96, 0.002)}, "your gyro reads 4.0 % low (0.960 +- 0.002)"),
        ("yaw_rate_scale", {"scale": (1.02, 0.002)}, "your gyro reads 2.0 % high (1.020 +- 0.002)"),
        (
            "antenna_lever_arm",
            {"forward_m": (0.85, 0.1)},
            "the antenna is 0.85 +- 0.10 m further ahead than configured",
        ),
        (
            "antenna_lever_arm",
            {"forward_m": (-0.85, 0.1), "left_m": (0.3, 0.02)},
            "the antenna is 0.85 +- 0.10 m further back than configured and"
            " the antenna is 0.30 +- 0.02 m further to the left than configured",
        ),
        ("gnss_latency", {"latency_s": (0.12, 0.004)}, "the fixes are 120 +- 4 ms older than configured"),
        (
            "centrifugal_growth",
            {"coefficient": (1.755e-6, 1e-7)},
            "the tyres grow with speed, by (1.76 +- 0.10)e-6 s2/m times its square",
        ),
    ],
)
def test_a_finding_is_a_clause(name: str, values: dict[str, tuple[float, float]], said: str) -> None:
    """Values in units that people read, with a word for their sign; only what was found is said."""
    units = {p.name: p.unit for p in EFFECTS[name].parameters}
    assert said == clause(
        name, {key: found_value(name, key, *pair, units[key]) for key, pair in values.items()}
    )


@pytest.mark.parametrize("name", list(EFFECTS))
def test_every_effect_is_reported_with_its_numbers(name: str) -> None:
    """Answers name parameters of the effect, and each that is fitted; without answers its sentence does."""
    effect = EFFECTS[name]
    fields = {
        field
        for answer in effect.wording.answers
        for _, field, _, _ in string.Formatter().parse(answer)
        if field
    }
    fitted = {p.name for p in effect.parameters if isinstance(p, Parameter) and p.probe > 0.0}
    assert fields <= {p.name for p in effect.parameters} | {"wheels"}
    assert not effect.wording.answers or fitted <= fields
    values: dict[str, FoundValue | str] = {
        p.name: found_value(name, p.name, p.typical, 0.1 * abs(p.typical), p.unit)
        if isinstance(p, Parameter)
        else "rear"
        for p in effect.parameters
    }
    assert "{" not in clause(name, values)
    assert len(clause(name, values)) > len(name)


def test_what_has_no_words_says_its_name_and_numbers() -> None:
    """An effect of a user's own is told by its name, without an error."""
    assert clause("own_effect", {"size_m": FoundValue(0.5, 0.1, "m")}) == "own_effect (size 0.50 +- 0.10 m)"
    assert noun("own_effect") == "own effect"


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.96, 0.0012, "0.9600 +- 0.0012"),
        (123.4, 30.0, "123 +- 30"),
        (1.755e-6, 1e-7, "(1.76 +- 0.10)e-6"),
        (0.25, None, "0.25"),
        (0.25, 0.0, "0.25"),
    ],
)
def test_a_value_ends_where_its_deviation_begins(value: float, std: float | None, text: str) -> None:
    """One digit of the deviation, two where it begins with 1."""
    assert text == rounded(value, std)
