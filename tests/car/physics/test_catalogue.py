"""The catalogue: names, parameters, bounds, and model files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.physics.catalogue import EFFECTS, make_effect, parse_effect
from tpmsd.car.physics.covariates import COVARIATES
from tpmsd.car.physics.effect import Effect, Kind, Parameter, Std, WheelParameter
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import format_model, load_model, parse_model, save_model
from tpmsd.car.physics.tyre import radius_change_for_pressure_loss
from tpmsd.foundation.errors import ConfigError

LATER = [
    "brake_slip",
    "drive_slip_curve",
    "load_static",
    "camber_roll",
    "brake_heat",
    "sun_side",
    "ambient_pressure",
    "wear",
    "road_bank",
    "doppler_heading_error",
    "clock_drift",
    "gnss_smoothing",
    "gyro_drift",
    "gyro_temperature",
    "gyro_misalignment",
    "accelerometer_bias",
    "accelerometer_tilt",
    "steering_offset",
    "steering_ratio_error",
    "compliance_steer",
    "counter_missed_pulses",
    "counter_extra_pulses",
    "message_delay",
    "speed_scale_nonlinearity",
    "speed_rounding_offset",
    "spare_or_mixed_tyre",
]
"""Of which the names alone are published."""
CONTRACT: dict[str, set[str]] = {
    "radius_change": {"wheel", "deviation_m", "onset_s", "duration_s"},
    "centrifugal_growth": {"coefficient"},
    "thermal_growth": {"amplitude_m", "time_constant_s"},
    "load_transfer_longitudinal": {"coefficient"},
    "load_transfer_lateral": {"coefficient"},
    "longitudinal_slip": {"slip_per_accel", "slip_per_speed2"},
    "lateral_slip": {"coefficient"},
    "road_grade": set(),
    "gnss_latency": {"latency_s"},
    "antenna_lever_arm": {"forward_m", "left_m"},
    "track_width_error": {"rear_m", "front_m"},
    "tone_ring_error": {"wheel", "amplitude_rad", "teeth_per_rev"},
    "yaw_rate_bias": {"bias"},
    "yaw_rate_scale": {"scale"},
    "velocity_lag": set(),
    "counter_lost_low_speed": set(),
    "wheel_spin": {"wheels", "slip", "onset_s", "duration_s"},
    "wheel_lock": {"wheels", "slip", "onset_s", "duration_s"},
    "unknown": set(),
    **{name: set() for name in LATER},
}


def test_the_catalogue_holds_every_published_effect() -> None:
    """Names and parameters are those of the public format; an effect may have more parameters."""
    findings = {name for name, effect in EFFECTS.items() if effect.kind is not Kind.NUISANCE}
    assert set(CONTRACT) <= findings
    for name, published in CONTRACT.items():
        assert published <= {parameter.name for parameter in EFFECTS[name].parameters}


def test_typical_sizes_lie_within_the_bounds() -> None:
    """Every parameter's typical value is a value that the parameter takes."""
    numbers = [p for cls in EFFECTS.values() for p in cls.parameters if not isinstance(p, WheelParameter)]

    assert [p.typical for p in numbers] == [p.check(p.typical) for p in numbers]


@pytest.mark.parametrize(
    ("name", "params", "message"),
    [
        ("centrifugal_grwth", {}, "unknown effect 'centrifugal_grwth', did you mean 'centrifugal_growth'?"),
        (
            "gnss_latency",
            {"latency": 1},
            "effect gnss_latency: unknown parameter 'latency', did you mean 'latency_s'? "
            "(parameters: latency_s)",
        ),
        ("road_grade", {"x": 1}, "effect road_grade: unknown parameter 'x' (parameters: it has none)"),
        (
            "centrifugal_growth",
            {"coefficient": 1},
            "effect centrifugal_growth: coefficient = 1 is outside -2e-05 to 2e-05 s2/m",
        ),
        (
            "lateral_slip",
            {},
            "effect lateral_slip: a required parameter is missing (not given: coefficient)",
        ),
        (
            "lateral_slip",
            {"coefficient": "much"},
            "effect lateral_slip: coefficient = 'much' is not a number",
        ),
        ("lateral_slip", {"coefficient": True}, "effect lateral_slip: coefficient = True is not a number"),
        (
            "lateral_slip",
            {"coefficient": float("nan")},
            "effect lateral_slip: coefficient = nan is outside -0.1 to 0.1 rad.s2/m",
        ),
        (
            "radius_change",
            {"wheel": "left", "deviation_m": 0.001},
            "effect radius_change: wheel = 'left' is not one of fl fr rl rr",
        ),
        (
            "unknown",
            {"on": "rl", "covariate": "speed", "knots": [10.0, 10.0], "heights": [0.0, 1e-3]},
            "effect unknown: knots[1] = 10 does not lie above knots[0] = 10",
        ),
        (
            "unknown",
            {"on": "rl", "covariate": "speed", "knots": [1.0, 2.0, 3.0], "heights": [0.0, 1e-3]},
            "effect unknown: 3 knots, but 2 heights",
        ),
        (
            "unknown",
            {"on": "rl", "covariate": "speed", "knots": [1.0, float("nan")], "heights": [0.0, 1e-3]},
            "effect unknown: knots[1] = nan is not a finite number",
        ),
        (
            "unknown",
            {"on": "rl", "covariate": "speed", "knots": [1.0], "heights": [0.0]},
            "effect unknown: knots has 1 entries, 2 to 200 are wanted",
        ),
        (
            "unknown",
            {"on": "rl", "covariate": "speed", "knots": 3.0, "heights": [0.0]},
            "effect unknown: knots = 3.0 is not a list of numbers",
        ),
        (
            "unknown",
            {"on": "gnss_speed", "covariate": "speed", "knots": [1.0, 2.0], "heights": ["a", 0.0]},
            "effect unknown: heights[0] = 'a' is not a number",
        ),
        (
            "unknown",
            {"on": "rl rr", "covariate": "speed", "knots": [1.0, 2.0], "heights": [0.0, 0.1]},
            "effect unknown: heights[1] = 0.1 is outside -0.05 to 0.05 m",
        ),
        (
            "unknown",
            {"on": "rl -rl", "covariate": "speed", "knots": [1.0, 2.0], "heights": [0.0, 0.0]},
            "effect unknown: on = 'rl -rl' names a wheel twice",
        ),
        (
            "unknown",
            {"on": "rear", "covariate": "speed", "knots": [1.0, 2.0], "heights": [0.0, 0.0]},
            "effect unknown: on = 'rear' holds 'rear', wanted are wheels (fl fr rl rr, with - for the other "
            "sign) or one of gnss_speed gnss_course yaw_rate",
        ),
        (
            "unknown",
            {"on": "rl", "covariate": "mood", "knots": [1.0, 2.0], "heights": [0.0, 0.0]},
            "effect unknown: covariate = 'mood' is not one of speed accel_long accel_lat yaw_rate steering "
            "steering_rate grade time distance temperature torque",
        ),
    ],
)
def test_what_an_effect_cannot_be_is_said_in_one_line(
    name: str, params: dict[str, object], message: str
) -> None:
    """Unknown names, missing parameters and impossible values raise a ConfigError that says which."""
    with pytest.raises(ConfigError, match=f"^{re.escape(message)}$"):
        make_effect(name, **params)


def test_an_effect_from_the_command_line() -> None:
    """name:parameter=value,parameter=value, with blanks where one likes."""
    assert make_effect("antenna_lever_arm", forward_m=0.2, left_m=-0.1) == parse_effect(
        "antenna_lever_arm: forward_m=0.2, left_m=-0.1"
    )
    assert make_effect("road_grade") == parse_effect("road_grade")
    with pytest.raises(ConfigError, match=r"^effect gnss_latency: '0.1' is not of the form parameter=value$"):
        parse_effect("gnss_latency:0.1")


def _effects() -> st.SearchStrategy[Effect]:
    def shapes(count: int) -> st.SearchStrategy[Effect]:
        knots = st.lists(st.floats(-1e3, 1e3), min_size=count, max_size=count, unique=True).map(sorted)
        return st.fixed_dictionaries(
            {
                "on": st.sampled_from(["rl rr", "fl -fr rl -rr", "-fl", "gnss_speed", "yaw_rate"]),
                "covariate": st.sampled_from(sorted(COVARIATES)),
                "knots": knots,
                "heights": st.lists(st.floats(-0.05, 0.05), min_size=count, max_size=count),
            }
        ).map(lambda given: make_effect("unknown", **given))

    def params(name: str) -> st.SearchStrategy[Effect]:
        if name == "unknown":
            return st.integers(2, 8).flatmap(shapes)
        values = {
            p.name: st.floats(p.lower, p.upper)
            if isinstance(p, Parameter)
            else st.sampled_from(["ramp", "exponential"] if p.name == "course" else ["fl", "fr", "rl", "rr"])
            for p in EFFECTS[name].parameters
        }
        return st.fixed_dictionaries(values).map(lambda given: make_effect(name, **given))

    return st.sampled_from(sorted(EFFECTS)).flatmap(params)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(_effects(), max_size=4), st.floats(0, 1e3), st.text(max_size=40))
def test_a_model_file_reads_back_what_was_written(effects: list[Effect], std: float, comment: str) -> None:
    """Effects, values and standard deviations survive the file bit for bit, whatever the comment says."""

    def stds_of(effect: Effect) -> dict[str, Std]:
        pairs = ((k, v) for k, v in effect.values().items() if not isinstance(v, str))
        return {key: (std,) * len(value) if isinstance(value, tuple) else std for key, value in pairs}

    model = ExtendedModel(tuple(effects), tuple(map(stds_of, effects)))

    assert model == parse_model(format_model(model, comment))


def test_a_model_file_on_disk(tmp_path: Path) -> None:
    """What is saved is loaded; the comment stands at the top."""
    model = ExtendedModel((make_effect("gnss_latency", latency_s=0.085),), ({"latency_s": 0.01},))
    save_model(tmp_path / "model.toml", model, "found on\nMonday")

    assert model == load_model(tmp_path / "model.toml")
    assert ["# found on", "# Monday"] == (tmp_path / "model.toml").read_text().splitlines()[:2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[effect]\n", "not TOML: .*"),
        ("effects = 1\n", "unknown key 'effects': a model file holds .*"),
        ("effect = 1\n", "'effect' must be written as .*"),
        ("[[effect]]\ncoefficient = 1.0\n", "effect 1 has no name"),
        (
            "[[effect]]\nname = 'road_grade'\nstd = 3\n",
            "effect road_grade: std must be a table",
        ),
        (
            "[[effect]]\nname = 'gnss_latency'\nlatency_s = 0.1\n[effect.std]\nx = 1\n",
            "effect gnss_latency: std of 'x', which it does not have",
        ),
        (
            "[[effect]]\nname = 'gnss_latency'\nlatency_s = 0.1\n[effect.std]\nlatency_s = -1\n",
            "effect gnss_latency: std.latency_s = -1 is not a number of at least 0",
        ),
        (
            "[[effect]]\nname = 'unknown'\non = 'rl'\ncovariate = 'speed'\nknots = [1, 2]\nheights = [0, 0]\n"
            "[effect.std]\nheights = [0.1]\n",
            "effect unknown: std.heights is not a list of 2 numbers",
        ),
        (
            "[[effect]]\nname = 'unknown'\non = 'rl'\ncovariate = 'speed'\nknots = [1, 2]\nheights = [0, 0]\n"
            "[effect.std]\nheights = [0.1, nan]\n",
            r"effect unknown: std.heights\[1\] = nan is not a number of at least 0",
        ),
        (
            "[[effect]]\nname = 'unknown'\non = 'rl'\ncovariate = 'speed'\nknots = [1, 2]\nheights = [0, 0]\n"
            "[effect.std]\non = 1\n",
            "effect unknown: std of 'on', which is no number",
        ),
    ],
)
def test_a_file_that_is_no_model_is_named_with_the_reason(tmp_path: Path, text: str, message: str) -> None:
    """One line: the file, then what is wrong with it."""
    path = tmp_path / "model.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=f"^{re.escape(str(path))}: {message}$"):
        load_model(path)


def test_a_model_file_that_is_not_there(tmp_path: Path) -> None:
    """A missing file is a ConfigError that names it."""
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read: No such file"):
        load_model(tmp_path / "none.toml")


@pytest.mark.parametrize(("loss", "millimetres"), [(0.2, -1.41), (0.25, -1.84), (0.3, -2.31), (0.0, 0.0)])
def test_a_loss_of_pressure_has_the_size_of_the_magic_formula(loss: float, millimetres: float) -> None:
    """At 304 mm, 4 kN, 220 kPa, 20 m/s the published sizes are met within 1 %."""
    assert pytest.approx(millimetres, rel=0.01) == 1000 * radius_change_for_pressure_loss(loss)


def test_a_larger_wheel_loses_more_radius_and_inflation_adds_some() -> None:
    """Sizes scale with the radius; a negative loss is more pressure and makes the wheel larger."""
    assert pytest.approx(2 * radius_change_for_pressure_loss(0.2)) == radius_change_for_pressure_loss(
        0.2, 0.608
    )
    assert radius_change_for_pressure_loss(-0.2) > 0
    with pytest.raises(ConfigError, match="pressure loss of 120 % is outside -50 to 100 %"):
        radius_change_for_pressure_loss(1.2)
