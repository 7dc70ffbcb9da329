"""Wheel slip by the tyre model as an explanatory variable of the diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.course import Course
from bench.worlds.instruments import observe
from bench.worlds.kinematic import Array, Spec, course
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import GRAVITY_MPS2, Car, Motion, driven_mask
from tpmsd.car.vehicle_state.settings import SETTINGS
from tpmsd.car.vehicle_state.slip_shapes import dynamics_of, wheel_slip_shapes
from tpmsd.offline.diagnosis.assessment.result import Explanatory
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.wheel_slip import SIDE_SLIP, slip_columns
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.report.diagnosis_document import diagnosis_document
from tpmsd.offline.report.diagnosis_summary import explanatory_sentence

STIFFNESS = 60.0
"""Slip stiffness over load: a stiff tyre, so that ten minutes hold no more than some thousand nats."""
BRAKES_FRONT, FRONT, HEIGHT, SPIN = 0.7, 0.5, 0.22, 0.024
"""Shares of brakes and weight at the front; height of the centre of gravity over the wheelbase; mass of an
axle's spinning wheels over the car's."""
PER_ACCEL = 1.0 / (STIFFNESS * GRAVITY_MPS2)
DRIVE = PER_ACCEL / (1.0 - FRONT)
BRAKE_FRONT, BRAKE_REAR = PER_ACCEL * BRAKES_FRONT / FRONT, PER_ACCEL * (1.0 - BRAKES_FRONT) / (1.0 - FRONT)
"""Slip per m/s2."""


def braking(road: Course) -> Array:
    """(n, 4) slip of a rear-driven car whose brakes act on all wheels.

    The tyre's slip stiffness goes with its load (Pacejka, Tyre and Vehicle Dynamics, 2012, section 4.3), and
    the road must spin up the wheels that the engine does not.
    """
    force = road.force / GRAVITY_MPS2
    load = np.stack([FRONT - HEIGHT * force, 1.0 - FRONT + HEIGHT * force], axis=1)
    drive, brakes = np.maximum(force, 0.0), np.minimum(force, 0.0)
    share = np.stack([BRAKES_FRONT * brakes - SPIN * drive, drive + (1.0 - BRAKES_FRONT) * brakes], axis=1)
    slip = share / (STIFFNESS * load)
    return slip[:, [0, 0, 1, 1]]


def recorded(seed: int, inertial: bool = True) -> Recording:
    """Ten minutes of that car."""
    rng = np.random.default_rng(seed)
    spec = Spec(duration_s=600.0, road="mixed", driven="rear")
    road = course(spec, rng)
    recording = recording_of(observe(replace(road, spin=braking(road)), spec, rng, seed))
    if inertial:
        return recording
    nothing = {name: np.full(recording.ticks, np.nan) for name in recording.inertial}
    return replace(recording, inertial=nothing)


def on_a_straight(accel_mps2: Array, driven: str) -> tuple[Motion, Car]:
    n = len(accel_mps2)
    still = np.zeros(n)
    time_s: Array = np.linspace(0.0, 0.1 * (n - 1), n)
    motion = Motion(
        time_s=time_s,
        distance_m=20.0 * time_s,
        speed_mps=np.full(n, 20.0),
        accel_long_mps2=accel_mps2,
        accel_lat_mps2=still,
        yaw_rate_radps=still,
        grade_rad=still,
        heading_rad=still,
        steering_rad=still,
    )
    car = Car(radius_m=np.full(4, 0.3), geometry=WheelPositions(1.5, 1.5, 2.6), driven=driven_mask(driven))
    return motion, car


@pytest.mark.parametrize("driven", ["front", "rear", "all"])
def test_small_forces_slip_in_proportion_to_the_acceleration(driven: str) -> None:
    """The driven axle under drive, each under brakes, in units of acceleration; free wheels are spun up."""
    accel = np.array([-0.02, 0.0, 0.02])
    shapes = wheel_slip_shapes(*on_a_straight(accel, driven))

    pulled = {"front": ["front"], "rear": ["rear"], "all": ["front", "rear"]}[driven]
    expected = sorted([f"{axle}_drive" for axle in pulled] + ["front_brake", "rear_brake"])
    assert expected == sorted(shapes)
    for name, shape in shapes.items():
        axle, how = name.split("_")
        on = [0, 1] if axle == "front" else [2, 3]
        off = [2, 3] if axle == "front" else [0, 1]
        share = np.maximum(accel, 0.0) if how == "drive" else np.minimum(accel, 0.0)
        assert np.stack([share, share], axis=1) == pytest.approx(shape[:, on], rel=2e-3)
        spun = SETTINGS.free_wheels * share if how == "drive" and driven != "all" else 0.0 * share
        assert np.stack([spun, spun], axis=1) == pytest.approx(-shape[:, off], rel=2e-3)


def test_braking_needs_less_slip_where_it_moves_the_weight() -> None:
    """By the static axle loads and m a h / l: slip per force falls as the load rises."""
    motion, car = on_a_straight(np.full(3, -3.0), "rear")
    dynamics = dynamics_of(car)
    shapes = wheel_slip_shapes(motion, car)

    moved = 3.0 * dynamics.height_m / dynamics.wheelbase_m / GRAVITY_MPS2
    front, rear = (x / dynamics.wheelbase_m for x in (dynamics.rear_m, dynamics.front_m))
    stiffer = (front + moved) / front / ((rear - moved) / rear)
    slope = shapes["front_brake"][0, 0] / shapes["rear_brake"][0, 2]
    assert slope * stiffer == pytest.approx(1.0, rel=0.02)  # sigma / (1 + sigma) differs by a hundredth


@pytest.mark.parametrize("inertial", [True, False])
def test_what_slips_would_gain_is_reported(inertial: bool) -> None:
    """Brakes that slip all wheels show in wheel slip, not in side slip; what the bus lacks is said."""
    diagnosis = diagnose([recorded(61, inertial)])
    reported = {one["variable"]: one for one in diagnosis_document(diagnosis, None)["explanatory"]}

    assert {"wheel_slip": "accel_long", "side_slip": "accel_lat"} == {
        k: v["covariate"] for k, v in reported.items()
    }
    assert reported["wheel_slip"]["alone"] > 1000.0 > 10.0 > reported["side_slip"]["alone"]
    # Spline terms over the acceleration were found, which say the same.
    assert reported["wheel_slip"]["beyond"] < 0.01 * reported["wheel_slip"]["alone"]
    assert (() if inertial else ("accel_long", "yaw_rate")) == reported["wheel_slip"]["without"]


def test_the_sentence_says_over_what_how_much_and_what_is_missing() -> None:
    """Below ten nats beyond the findings there is none."""
    slip = Explanatory("wheel_slip", "accel_long", 250.0, 30.0, ("accel_long",))

    assert (
        "Wheel slip by the tyre model of a typical car, over accel_long, would gain 30 nats beyond this"
        " (250 alone, both in sample);"
        " without accel_long on the bus it is estimated from the wheels' own motion."
    ) == explanatory_sentence(slip)
    assert "" == explanatory_sentence(replace(slip, beyond=9.0))


def test_one_axle_alone_has_no_hypothesis_of_wheel_slip() -> None:
    """What one axle slips GNSS latency does as well; side slip is still reported."""
    whole = recorded(62)
    rear = replace(whole, rotation_rad=np.where([False, False, True, True], whole.rotation_rad, np.nan))
    names = {name[0] for name, _ in slip_columns(Reader(rear, reference(rear)))}

    assert {SIDE_SLIP} == names
