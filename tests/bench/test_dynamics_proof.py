"""The proof of vehicle dynamics: mirrored drivers, joined manoeuvres, tables in a page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vehiclemodels")

from bench.campaigns.offline import dynamics_proof
from bench.campaigns.offline.dynamics_proof import (
    JUDGED,
    PAUSE_S,
    SENSORS,
    courses,
    joined,
    main,
    manoeuvre,
    proof,
    put,
    sided,
    workshop_car,
)
from bench.cli import parse
from bench.registry import UsageError
from bench.worlds.commonroad_car import Now
from tpmsd.car.physics.baselines.three_dof import ThreeDof


def test_a_mirrored_driver_steers_to_the_other_side() -> None:
    """What he sees is mirrored, and what he does: a driver who follows a line follows its mirror image."""

    def driver(now: Now) -> tuple[float, float]:
        return 0.1 * (3.0 - now.north_m) - 0.2 * now.heading_rad, 0.5

    left = Now(1.0, 10.0, 1.0, 0.1, 20.0, 0.2, 0.3)
    right = Now(1.0, 10.0, -1.0, -0.1, 20.0, -0.2, -0.3)

    assert sided(driver, -1.0)(right) == (-driver(left)[0], 0.5)
    assert sided(driver, 1.0)(left) == driver(left)


def test_manoeuvres_are_joined_with_pauses() -> None:
    """No block reaches over a pause, and the steering's rate is that of each manoeuvre."""
    time = np.arange(0.0, 9.0, 0.01)
    part = {
        "time": time,
        "steer": 0.01 * time,
        **{name: np.ones(len(time)) for name in (*SENSORS, "drive", "brake")},
    }
    drive = joined([part, part])

    assert np.diff(drive.time_s).max() == pytest.approx(PAUSE_S)
    assert not drive.linked[len(time) - 1]
    assert drive.inputs.steer_rate_radps == pytest.approx(0.01)


def test_tables_go_between_their_marks(tmp_path: Path) -> None:
    """The rest of the page stays; a page without the marks is refused."""
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- x -->\nold\n<!-- /x -->\nb\n")
    put(page, {"x": "new"})

    assert page.read_text() == "a\n<!-- x -->\nnew\n<!-- /x -->\nb\n"
    with pytest.raises(UsageError, match="no marks"):
        put(page, {"y": "new"})


def test_a_page_without_marks_is_refused_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table that finds no place after half an hour is lost; the page of an empty check stays as it was."""
    monkeypatch.setattr(dynamics_proof, "multibody", lambda seed: pytest.fail("computed first"))
    page = tmp_path / "page.md"
    for text in (None, "no marks"):
        if text is not None:
            page.write_text(text)
        with pytest.raises(UsageError, match=r"page\.md"):
            main(parse(["run", "dynamics-proof", "--page", str(page)]))

    page.write_text("<!-- x -->\nold\n<!-- /x -->\n")
    put(page, {"x": ""})
    assert page.read_text() == "<!-- x -->\nold\n<!-- /x -->\n"


def test_what_is_found_at_one_speed_predicts_another() -> None:
    """Three manoeuvres of the multi-body car: yaw rate and lateral acceleration to both sides, at another
    speed, have at most 0.6 of the 3-DOF car's errors; the first row alone is named as the baseline."""
    rng = np.random.default_rng(3)
    learnt = joined([manoeuvre(*one, rng) for one in courses(70.0)[:3]])
    judged = joined([manoeuvre(*one, rng) for one in courses(65.0)])

    proved = proof("small", ThreeDof(workshop_car(), forces=True), learnt, judged, JUDGED)
    errors = proved.errors

    assert [model == "`three-dof`" for model in proved.models] == [True] + [False] * (len(errors) - 1)
    assert errors[-1]["yaw_rate"] < 0.6 * errors[0]["yaw_rate"]
    assert errors[-1]["accel_lat"] < 0.6 * errors[0]["accel_lat"]
