"""The scorer: names, places, parameters, and what was won."""

from __future__ import annotations

import json
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.campaigns.offline.diagnosis.draw import (
    CONCEALED,
    EFFECTS,
    MULTIBODY,
    STRANGE,
    TOGETHER,
    draw_case,
)
from bench.campaigns.offline.diagnosis.make import make
from bench.campaigns.offline.diagnosis.score import improvement, localisation, match, parameter_errors, score
from bench.campaigns.offline.diagnosis.seal import diagnosed
from bench.campaigns.offline.diagnosis.truth import Concealed, Truth, seen_as, truth_of
from bench.statistics import share
from bench.worlds.instruments import observe
from bench.worlds.kinematic import course
from bench.worlds.spec import Spec


def concealed(effect: str, spans: list[list[float]], wheels: list[str], **parameters: Any) -> Concealed:
    return Concealed(effect, effect, parameters, 99.0, 99.0, "", wheels, ["wheel_ratio"], ["time"], spans)


def truth(*effects: Concealed) -> Truth:
    return Truth("made up", 1.0, 1, "kinematic", list(effects))


def finding(effect: str, spans: list[list[float]] | None = None, **parameters: Any) -> dict[str, Any]:
    wheel = [parameters["wheel"]] if "wheel" in parameters else []
    values = {
        name: {"value": value, "std": None if isinstance(value, str) else 0.5, "unit": ""}
        for name, value in parameters.items()
    }
    where = {"wheels": wheel, "channel": "wheel_ratio", "covariate": None, "range": None}
    return {"effect": effect, "parameters": values, "where": {**where, "time_spans": spans or []}}


def test_a_leak_on_another_wheel_is_a_wrong_name() -> None:
    """The wheel is part of what a leak is."""
    true = truth(concealed("radius_change", [[0.0, 9.0]], ["rl"], wheel="rl"))

    assert [None, 0] == match(
        true, [finding("radius_change", wheel="fr"), finding("radius_change", wheel="rl")]
    )


def test_an_effect_is_found_but_once_and_strange_physics_may_take_several_terms() -> None:
    """A second finding of the same name is false; a second `unknown` is not."""
    true = truth(concealed("gnss_latency", [[0.0, 9.0]], []), concealed("unknown", [[0.0, 9.0]], ["fl"]))

    assert [0, None] == match(true, [finding("gnss_latency"), finding("gnss_latency")])
    assert [1, 1] == match(true, [finding("unknown"), finding("unknown")])


def false_names(world_nats: float, doppler_age_s: float, *findings: dict[str, Any]) -> list[str]:
    """Names scored as false on a drive that conceals nothing, with so much of the world's own physics."""
    case = draw_case("nothing", 1.0, 1)
    case = replace(case, spec=replace(case.spec, doppler_age_s=doppler_age_s))
    true = replace(truth(), beyond=world_nats)
    document = {"findings": [{**each, "confidence": 0.99} for each in findings]}
    row = score(case, true, document, {}, None)  # type: ignore[arg-type]  # nothing concealed, no windows
    return list(row["false"])


def test_what_tyres_of_the_world_and_its_receiver_do_is_no_false_name() -> None:
    """Brake slip is true where tyres slip, a lag where the Doppler is old, right to within its doubt."""
    brake, lag = finding("brake_slip", front=0.005), finding("velocity_lag", lag_s=0.08)
    lag["parameters"]["lag_s"]["std"] = 0.003

    assert ["brake_slip"] == false_names(0.0, 0.0, brake)
    assert [] == false_names(99.0, 0.0, brake)
    assert [] == false_names(0.0, 0.085, lag)
    assert ["velocity_lag"] == false_names(0.0, 0.03, lag)
    assert ["velocity_lag"] == false_names(0.0, 0.0, lag)


def test_physics_by_another_formula_bears_the_name_of_its_cause() -> None:
    """The catalogue has brakes that heat an axle and a Doppler that errs by heading; camber it has not."""
    kinds = ("strange_brake_heat", "strange_heading_glitch", "strange_camber", "radius_change_2")

    assert ["brake_heat", "doppler_heading_error", "unknown", "radius_change"] == [seen_as(k) for k in kinds]


def test_parameter_errors_are_in_standard_deviations_and_relative() -> None:
    """A scale's relative error is that of its difference from one."""
    true = truth(concealed("yaw_rate_scale", [[0.0, 9.0]], [], scale=1.02))
    rows = parameter_errors(true, [finding("yaw_rate_scale", scale=1.52)], [0])

    assert [["yaw_rate_scale", "scale", 1.0, pytest.approx(25.0)]] == rows


def test_a_place_found_in_half_its_time_has_a_recall_of_a_half() -> None:
    """F1 of precision 1 and recall 1/2 is 2/3; the wrong wheel has none."""
    spec = Spec(duration_s=200.0)
    road = course(spec, np.random.default_rng(3))
    from bench.campaigns.offline.diagnosis.signals import windows_of

    windows = windows_of(road, observe(road, spec, np.random.default_rng(3), 3))
    windows.read[:] = True
    true = truth(concealed("radius_change", [[100.0, 200.0]], ["rl"], wheel="rl"))
    half = finding("radius_change", [[150.0, 200.0]], wheel="rl")
    other = finding("radius_change", [[100.0, 200.0]], wheel="rr")

    assert localisation(true, [half], windows) == pytest.approx(2 / 3, abs=0.01)
    assert 0.0 == localisation(true, [other], windows)


def test_the_true_model_reaches_all_of_the_gain_and_none_reaches_nothing(tmp_path: Path) -> None:
    """Share of the reachable gain, and the bias of the radii before and after."""
    case = draw_case("centrifugal_growth", 1.0, 4)
    windows = make(case, tmp_path).windows
    model = {"effect": [{"name": "centrifugal_growth", **case.spec.physics["centrifugal_growth"]}]}
    won, (before, after) = improvement(case, model, windows)

    assert (1.0, 0.0) == (won, after)
    assert before > 0.1
    assert (0.0, [before, before]) == improvement(case, {}, windows)


def test_every_kind_can_be_drawn_and_the_same_seed_draws_the_same() -> None:
    """Kinds of all lists; another seed is another car."""
    for kind in (*EFFECTS, *STRANGE, *TOGETHER, *CONCEALED, *MULTIBODY, "nothing", "nothing_wander"):
        assert draw_case(kind, 0.5, 7) == draw_case(kind, 0.5, 7)
        assert draw_case(kind, 0.5, 7).spec.radius_m != draw_case(kind, 0.5, 8).spec.radius_m
    with pytest.raises(ValueError, match="no kind that is known"):
        draw_case("phlogiston", 1.0, 1)


def test_intervals_are_those_of_clopper_and_pearson() -> None:
    """None of ten: the upper bound solves (1 - p)^10 = 0.025 (a closed form)."""
    none = share(0, 10)

    assert (0.0, pytest.approx(1 - 0.025**0.1)) == (none["low"], none["high"])


def test_the_truth_survives_its_seal(tmp_path: Path) -> None:
    """What is read back from the sealed file is what was written."""
    case = draw_case("radius_change+thermal_growth", 1.0, 3)
    true = truth_of(case, make(case, tmp_path).windows)

    assert true == Truth.of(json.loads(json.dumps(true.plain())))


def test_the_diagnosing_process_learns_of_no_place_but_the_drive_and_its_report(tmp_path: Path) -> None:
    """A stand-in for the program writes down all that it was given."""
    program = tmp_path / "program" / "tpmsd"
    program.mkdir(parents=True)
    (program / "__init__.py").write_text("", encoding="utf-8")
    (program / "__main__.py").write_text(
        textwrap.dedent(
            """
            import json, os, pathlib, sys
            given = {"argv": sys.argv[1:], "environment": dict(os.environ), "cwd": os.getcwd(),
                     "files": sorted(os.listdir(".")),
                     "modes": [oct(p.stat().st_mode & 0o777)
                               for p in pathlib.Path(sys.argv[2]).parent.glob("sealed-*")]}
            pathlib.Path(sys.argv[4]).write_text(json.dumps(given))
            """
        ),
        encoding="utf-8",
    )
    case = draw_case("radius_change", 1.0, 3)
    spec = Spec(duration_s=60.0, physics=case.spec.physics)
    road = course(spec, np.random.default_rng(3))
    drive = observe(road, spec, np.random.default_rng(3), 3)
    true = truth(concealed("radius_change", [[0.0, 9.0]], ["rl"], wheel="rl"))
    answer, opened = diagnosed(drive, true, program.parent)
    given = answer.document

    assert ("", true) == (answer.error, opened)
    assert ["bus.dbc", "can.log", "gnss.nmea", "vehicle.toml"] == given["files"]
    assert not [text for text in json.dumps(given).split('"') if "sealed" in text]
    assert set(given["modes"]) == {"0o700"}
    assert {"PATH", "LANG", "PYTHONPATH"} <= set(given["environment"])
    assert "TMPDIR" not in given["environment"]
    assert not Path(given["cwd"]).exists()
