"""What cars, tyres, receivers and control units do, by other formulas than those of the catalogue.

In: `Course`, `Spec` whose `physics` names causes. Out: changes of radii, slips and readings. The catalogue
of effects has one line for each, mostly the first term of a series; here stand the whole tyre, two thermal
masses, rotations, edges and filters. Which cause goes by which name is said in
`bench/campaigns/offline/effect_cases.py`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.signal import lfilter

from bench.worlds.magic_tyre import FZ0_N, Tyre
from bench.worlds.motion import Array, Course, G
from bench.worlds.spec import Spec

DRAG_PER_M, ROLLING_MPS2 = 2.7e-4, 0.1
"""What slows a car that rolls: by the speed squared, and always."""
MAX_SHARE = 0.95
"""Of the grip that a tyre is asked for."""
ROLL_RAD_PER_MPS2 = 6e-3
LEFT = np.array([1.0, -1.0, 1.0, -1.0])
FRONT = np.array([True, True, False, False])
DRIVEN = {
    "front": np.array([True, True, False, False]),
    "rear": np.array([False, False, True, True]),
    "all": np.array([True, True, True, True]),
}


def lagged(values: Array, step_s: float, tau_s: float) -> Array:
    """(n,) behind a first-order lag that starts at the first value."""
    keep = math.exp(-step_s / tau_s)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, zi=[keep * values[0]])[0])


def accumulated(rate: Array, step_s: float, loss_per_s: Array | float) -> Array:
    """(n,) of y' = rate - loss * y from zero, by exponentials over each step."""
    keep = np.exp(-np.broadcast_to(loss_per_s, rate.shape) * step_s)
    out = np.zeros(len(rate))
    for k in range(1, len(rate)):
        out[k] = keep[k] * out[k - 1] + rate[k] * step_s
    return out


def grip_slip(force: Array, stiffness: float, most: float, shape: float = 1.45) -> Array:
    """Slip of the Magic Formula's tyre (Pacejka 2012, eq. 4.49 without curvature) under a force per mass.

    `stiffness` is force per slip where both are small, `most` the grip, both in m/s2.
    """
    asked = np.clip(force / most, -MAX_SHARE, MAX_SHARE)
    return np.asarray(np.tan(np.arcsin(asked) / shape) * shape * most / stiffness)


def radius_change(course: Course, spec: Spec) -> Array:
    """(n, 4) change of the rolling radii in metres."""
    out = np.zeros((len(course.time_s), 4))
    for name, act in RADII.items():
        if name in spec.physics:
            out += act(course, spec, spec.physics[name])
    return out


def _belt(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """The belt grows with speed and stiffens as it does."""
    v = course.speed
    return np.asarray((p["growth"] * v**2 / (1.0 + (v / 90.0) ** 2))[:, None])


def _rolling_heat(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Rolling warms the tyres by the way, the wind cools them the more the faster they go."""
    step = float(course.time_s[1] - course.time_s[0])
    warm = accumulated(course.speed / 20.0 / p["time_constant_s"], step, _cooling(course, p))
    return np.asarray((p["size_m"] * warm)[:, None])


def _cooling(course: Course, p: dict[str, Any]) -> Array:
    return np.asarray((0.7 + 0.3 * course.speed / 20.0) / p["time_constant_s"])


def _brake_discs(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Discs take the energy of the brakes and give it to the rims within 15 s, these give it to the air."""
    step = float(course.time_s[1] - course.time_s[0])
    power = np.maximum(-course.force, 0.0) * course.speed
    into_rims = accumulated(power / 15.0, step, 1.0 / 15.0)
    rims = accumulated(into_rims, step, 1.0 / p["cooling_s"])
    return np.asarray(p["per_energy"] * rims[:, None] * np.isin(np.arange(4), p["wheels"]))


def _sun(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """The flank that faces the sun is warmed by the cosine of its angle, the other one not at all."""
    step = float(course.time_s[1] - course.time_s[0])
    facing = p["east"] * -np.sin(course.heading) + p["north"] * np.cos(course.heading)
    sides = [lagged(np.maximum(sign * facing, 0.0), step, p["lag_s"]) for sign in (1.0, -1.0)]
    return np.asarray(2.0 * p["size_m"] * np.stack([*sides, *sides], axis=1))


def _barometer(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """The gauge pressure rises by what the air's falls (ISO 2533)."""
    step = float(course.time_s[1] - course.time_s[0])
    up = np.cumsum(course.speed * np.sin(course.grade)) * step
    air_pa = 101_325.0 * (1.0 - 2.25577e-5 * (400.0 + up)) ** 5.25588
    return np.asarray((p["m_per_pa"] * (air_pa[0] - air_pa))[:, None])


def _camber(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """A crowned tread that leans touches the road on a smaller circle; wheels lean as the body rolls."""
    step = float(course.time_s[1] - course.time_s[0])
    lean = p["lean_rad_per_mps2"] * lagged(course.a_lat, step, 0.15)
    return np.asarray(-p["crown_m"] * (1.0 - np.cos(lean))[:, None])


def _loads(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Forces that shift between the tyres bend their carcasses: by the whole curve of the tyre."""
    shift = np.full((len(course.time_s), 4), FZ0_N)
    shift += p.get("n_per_lateral", 0.0) * course.a_lat[:, None] * -LEFT
    shift += p.get("n_per_long", 0.0) * course.force[:, None] * np.where(FRONT, -1.0, 1.0)
    return np.asarray(_bent(shift, p["softness"]))


def _bent(force_n: Array, softness: float) -> Array:
    tyre = Tyre(softness=softness)
    one = np.ones(1)
    return np.asarray(
        tyre.effective_radius_m(force_n, one, one) - tyre.effective_radius_m(one * FZ0_N, one, one)
    )


def _luggage(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Load comes onto the rear axle at the longest stop."""
    force = np.full((len(course.time_s), 4), FZ0_N)
    force[longest_stop_end(course) :, 2:] += p["n_per_wheel"]
    return np.asarray(_bent(force, 1.0))


def longest_stop_end(course: Course) -> int:
    """Index of the instant after the longest standstill between two stretches of driving."""
    moving = np.flatnonzero(course.speed > 0.2)
    gap = int(np.argmax(np.diff(moving)))
    return int(moving[gap + 1])


def _leak(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Air leaves a tyre the slower the less is left, down to a share."""
    since = np.maximum(course.time_s - p["onset_s"], 0.0)
    gauge = 1.0 - p["lost"] * (1.0 - np.exp(-since / p["within_s"]))
    tyre, force = Tyre(), np.full(1, FZ0_N)
    change = tyre.effective_radius_m(force, gauge, np.ones(1)) - tyre.effective_radius_m(
        force, np.ones(1), np.ones(1)
    )
    return np.asarray(change[:, None] * (np.arange(4) == p["wheel"]))


def _chain_rings(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Rings around the tyres of an axle make larger wheels of them, from one stop to another."""
    on = (course.time_s >= p["onset_s"]) & (course.time_s < p["onset_s"] + p["duration_s"])
    return np.asarray(p["thick_m"] * on[:, None] * np.isin(np.arange(4), p["wheels"]))


def _spare(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """One wheel of another size."""
    return np.asarray(np.ones((len(course.time_s), 1)) * p["size_m"] * (np.arange(4) == p["wheel"]))


def _stuck_caliper(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """What a brake that does not let go warms: a disc, and by it the tyre, each with a lag of its own."""
    return np.asarray(
        p["m_per_slip"] * p["slip"] * _stuck_warmth(course, p)[:, None] * (np.arange(4) == p["wheel"])
    )


def _stuck_warmth(course: Course, p: dict[str, Any]) -> Array:
    """(n,) 1 at 20 m/s for long: the disc within 20 s, the rim slowly."""
    step, tau = float(course.time_s[1] - course.time_s[0]), p["cooling_s"]
    disc = accumulated(course.speed / 20.0 / 20.0, step, 1.0 / 20.0)
    return accumulated(disc / tau, step, 1.0 / tau)


RADII = {
    "stuck_caliper": _stuck_caliper,
    "belt": _belt,
    "rolling_heat": _rolling_heat,
    "brake_discs": _brake_discs,
    "sun": _sun,
    "barometer": _barometer,
    "camber": _camber,
    "loads": _loads,
    "luggage": _luggage,
    "leak": _leak,
    "chain_rings": _chain_rings,
    "spare": _spare,
}


def pull(course: Course) -> Array:
    """(n,) force per mass that the tyres bring up: for acceleration, slope, air and rolling."""
    return np.asarray(course.force + DRAG_PER_M * course.speed**2 + ROLLING_MPS2)


def slip(course: Course, spec: Spec) -> Array:
    """(n, 4) relative surplus of turning."""
    out = np.zeros((len(course.time_s), 4))
    driven, force = DRIVEN[spec.driven], pull(course)
    if "grip" in spec.physics:  # driven wheels on a road of some grip, under drive and engine brake alike
        p = spec.physics["grip"]
        out += grip_slip(force, p["stiffness"], p["most"])[:, None] * driven
    if "brake_force" in spec.physics:
        p = spec.physics["brake_force"]
        braking = np.minimum(force, 0.0)
        for axle, share in ((FRONT, p["front_share"]), (~FRONT, 1.0 - p["front_share"])):
            out += grip_slip(share * braking, p["stiffness"], p["most"])[:, None] * axle
    if "axles" in spec.physics:  # all wheels driven, one axle more than the other
        p = spec.physics["axles"]
        for axle, share in ((FRONT, p["front_share"]), (~FRONT, 1.0 - p["front_share"])):
            out += grip_slip(2.0 * share * force, p["stiffness"], 9.0)[:, None] * axle
    if "differential" in spec.physics:  # the same torque left and right, stiffness by what each tyre carries
        p = spec.physics["differential"]
        load = 1.0 - p["load_per_lateral"] * course.a_lat[:, None] * LEFT
        carried = np.maximum(load, 0.2) * (1.0 - 0.1 * (load - 1.0))
        shared = np.where(driven, np.maximum(force, 0.0)[:, None], 0.0)
        shared = shared + np.minimum(force, 0.0)[:, None] * p["brake_share"]
        out += shared / p["stiffness"] / carried
    for name, act in SLIPS.items():
        if name in spec.physics:
            out += act(course, spec, spec.physics[name])
    if "dragging_brake" in spec.physics:  # a brake that holds an axle back for a while, on ice
        p = spec.physics["dragging_brake"]
        since = course.time_s - p["onset_s"]
        acting = np.clip(np.minimum(since, p["duration_s"] - since) / 0.3, 0.0, 1.0)
        out += p["slip"] * acting[:, None] * np.isin(np.arange(4), p["wheels"])
    return out


def _viscous(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """A viscous coupling holds the wheels of an axle together against the stiffness of the tyres."""
    share = p["coupling"] / (1.0 + p["coupling"])
    track = np.where(FRONT, spec.track_front_m, spec.track_rear_m)
    apart = 0.5 * course.yaw[:, None] * track * LEFT
    return np.asarray(share * apart / (np.maximum(course.speed, 0.5)[:, None] - apart) * DRIVEN[spec.driven])


def _rolled_along(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """Wheels that are turned roll the length of the path, not of the body's way."""
    return np.asarray((np.hypot(1.0, np.tan(rear_angle(course, spec))) - 1.0)[:, None] * ~FRONT)


def _airstream(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """The drag in the wind, less that in calm air, on tyres of that stiffness."""
    direction = np.exp(1j * course.heading)
    air = np.real((course.speed * direction + p["east_mps"] + 1j * p["north_mps"]) * direction.conj())
    more = DRAG_PER_M * (np.sign(air) * air**2 - course.speed**2)
    return grip_slip(more, p["stiffness"], 9.0)[:, None] * DRIVEN[spec.driven]


def _stuck(course: Course, spec: Spec, p: dict[str, Any]) -> Array:
    """The force of the brake grows with the disc's warmth."""
    grown = 1.0 + _stuck_warmth(course, p)
    return np.asarray(-p["slip"] * grown[:, None] * (np.arange(4) == p["wheel"]))


SLIPS = {"viscous": _viscous, "rear_rack": _rolled_along, "airstream": _airstream, "stuck_caliper": _stuck}


def rear_angle(course: Course, spec: Spec) -> Array:
    """(n,) angle of rear wheels that are steered: against the front ones when slow, with them when fast."""
    if "rear_rack" not in spec.physics:
        return np.zeros(len(course.time_s))
    p = spec.physics["rear_rack"]
    with_them = np.tanh(np.log(np.maximum(course.speed, 0.1) / p["straight_mps"]))
    return np.asarray(p["share"] * with_them * np.arctan(spec.wheelbase_m * course.bend))


def shown_rates(rates: Array, course: Course, spec: Spec) -> Array:
    """(n, 4) turning rates as a control unit shows them on the average."""
    physics, pitch = spec.physics, 2.0 * math.pi / spec.teeth
    if "axle_messages" in physics:  # the front wheels' message is sent later than it is made
        then = course.time_s - physics["axle_messages"]["late_s"]
        rates = rates.copy()
        for k in (0, 1):
            rates[:, k] = np.interp(then, course.time_s, rates[:, k])
    if "dashboard" in physics:  # a filter of its own in front of what is sent
        step = float(course.time_s[1] - course.time_s[0])
        rates = np.stack([lagged(one, step, physics["dashboard"]["tau_s"]) for one in rates.T], axis=1)
    if "capture" in physics:  # a timer that reads each period between edges too short
        rates = rates / (1.0 - rates / pitch * physics["capture"]["short_s"])
    if "truncated" in physics:  # whole steps of the speed, what is over is left out
        rates = rates - 0.5 * spec.speed_step_kmh / 3.6 / spec.configured_radius_m
    if "pulses" in physics:
        p = physics["pulses"]
        rates = rates + p["per_s"] * pitch * (np.arange(4) == p["wheel"])
    return np.asarray(rates)


def pulse_scatter(course: Course, spec: Spec, rng: np.random.Generator) -> Array:
    """(n, 4) angle by which pulses come at random (Poisson), beyond their average of `shown_rates`."""
    out = np.zeros((len(course.time_s), 4))
    if "pulses" in spec.physics:
        p, step = spec.physics["pulses"], float(course.time_s[1] - course.time_s[0])
        expected = abs(p["per_s"]) * step
        came = rng.poisson(expected, len(out)) - expected
        out[:, p["wheel"]] = math.copysign(2.0 * math.pi / spec.teeth, p["per_s"]) * np.cumsum(came)
    return out


def ring_error(angle: Array, spec: Spec) -> Array:
    """(n, 4) angle shown minus angle turned, of a ring whose middle is off the axle's."""
    out = np.zeros_like(angle)
    if "eccentric_ring" in spec.physics:
        p = spec.physics["eccentric_ring"]
        turned = angle[:, p["wheel"]] + p["phase_rad"]
        off = p["eccentricity"]
        out[:, p["wheel"]] = np.arctan2(off * np.sin(turned), 1.0 + off * np.cos(turned))
    return out


def gyro_error(course: Course, spec: Spec) -> Array:
    """(n,) what the gyro reads more than the yaw rate."""
    physics, t = spec.physics, course.time_s
    out = np.zeros(len(t))
    step = float(t[1] - t[0])
    if "warming_gyro" in physics:
        p = physics["warming_gyro"]
        out += p["size_radps"] * (1.0 - np.exp(-t / p["warming_s"]))
    if "leaning_gyro" in physics:  # what a rotated axis sees of the whole rotation
        p = physics["leaning_gyro"]
        pitch_rate, roll_rate = (
            -np.gradient(course.grade, step),
            ROLL_RAD_PER_MPS2 * np.gradient(course.a_lat, step),
        )
        side, ahead = p["sideways_rad"], p["forward_rad"]
        upright = math.cos(side) * math.cos(ahead)
        out += (upright - 1.0) * course.yaw + math.sin(side) * pitch_rate
        out += math.sin(ahead) * math.cos(side) * roll_rate
    if "cold_gyro" in physics:
        p = physics["cold_gyro"]
        out += p["per_kelvin"] * (ambient_k(course, spec) - 293.0)
    return out


def ambient_k(course: Course, spec: Spec) -> Array:
    """(n,) temperature outside: out of a garage, and down towards the evening."""
    p = spec.physics.get("cold_gyro", {"fall_k": 0.0})
    return np.asarray(293.0 - p["fall_k"] * (1.0 - np.exp(-course.time_s / 250.0)))


def accelerations(course: Course, spec: Spec) -> tuple[Array, Array]:
    """(n,) each: what accelerometers forward and to the left read without noise."""
    physics = spec.physics
    along, across = course.force, course.a_lat
    if "banked_bends" in physics:  # the road leans into each bend, with ramps of its own
        p = physics["banked_bends"]
        step = float(course.time_s[1] - course.time_s[0])
        bank = np.arctan(p["share"] * lagged(course.a_lat, step, 0.5) / G)
        across = across * np.cos(bank) - G * np.sin(bank)
    if "turned_mount" in physics:  # rotations one after the other: about the vertical, then nose, then side
        p = physics["turned_mount"]
        up = np.full(len(along), G)
        cos, sin = math.cos(p["yaw_rad"]), math.sin(p["yaw_rad"])
        along, across = cos * along + sin * across, cos * across - sin * along
        cos, sin = math.cos(p["pitch_rad"]), math.sin(p["pitch_rad"])
        along, up = cos * along + sin * up, cos * up - sin * along
        cos, sin = math.cos(p["roll_rad"]), math.sin(p["roll_rad"])
        across = cos * across + sin * up
    if "zero_level" in physics:
        p = physics["zero_level"]
        along, across = along + p["along_mps2"], across + p["across_mps2"]
    return np.asarray(along), np.asarray(across)


def steering_wheel(course: Course, spec: Spec, ratio: float) -> Array:
    """(n,) steering wheel's angle without noise, of a rack of that configured ratio."""
    physics = spec.physics
    road = np.arctan(spec.wheelbase_m * course.bend)
    if "understeer" in physics:  # tyres and bushings give way within a tenth of a second
        step = float(course.time_s[1] - course.time_s[0])
        road = road + physics["understeer"]["rad_per_mps2"] * lagged(course.a_lat, step, 0.1)
    if "rack" in physics:  # quicker towards the lock
        p = physics["rack"]
        ratio = ratio * p["ratio"]
        road = road * (1.0 - 0.1 * np.minimum(np.abs(road) / 0.5, 1.0))
    return np.asarray(ratio * road + physics.get("column", {}).get("off_rad", 0.0))


def received_velocity(east: Array, north: Array, course: Course, spec: Spec) -> tuple[Array, Array]:
    """(n,) each: the antenna's velocity as the receiver's loops make it, without noise."""
    physics, step = spec.physics, float(course.time_s[1] - course.time_s[0])
    if "late_doppler" in physics:
        then = course.time_s - physics["late_doppler"]["late_s"]
        east, north = (np.interp(then, course.time_s, part) for part in (east, north))
    if "velocity_filter" in physics:  # of the vector, not of its size and direction
        tau_s = physics["velocity_filter"]["tau_s"]
        east, north = lagged(east, step, tau_s), lagged(north, step, tau_s)
    if "moving_sky" in physics:  # one vector from the satellites' errors, whatever the car does
        p = physics["moving_sky"]
        east, north = east + p["east_mps"], north + p["north_mps"]
    return east, north


def clock_error_s(since_s: Array, spec: Spec) -> Array:
    """(n,) host's clock minus UTC beyond a constant: a crystal that warms up while it drifts."""
    if "crystal" not in spec.physics:
        return np.zeros_like(since_s)
    p = spec.physics["crystal"]
    return np.asarray(p["rate"] * since_s + p["bend_s"] * (1.0 - np.exp(-since_s / 200.0)))
