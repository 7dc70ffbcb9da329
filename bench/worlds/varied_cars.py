"""Drives of cars of every size, many at once: four wheels, tyres of four laws, concealed physics.

In: `Case`s, a generator. Out: `Recorded` for each case: columns of a `signals.csv` and the text of a
`vehicle.toml`. Masses of 900 to 3,500 kg, wheelbases of 2.3 to 4 m, understeer and oversteer.

Written from Pacejka, "Tire and Vehicle Dynamics", 3rd ed., 2012 (brush model of section 3.2, Magic Formula of
section 4.3.1, first-order relaxation of section 5.3), Dugoff, Fancher and Segel, "An analysis of tire
traction properties", 1970, and Hindiyeh and Gerdes, "A controller framework for autonomous drifting", 2014 (a
longitudinal force takes sqrt(1 - (F_x / mu F_z)^2) of the friction that is left
to the side). The states of all cars are arrays, and Heun's rule takes steps of 2.5 ms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_S = 2.5e-3
G = 9.80665
RHO = 1.2041
TYRES = ("linear", "brush", "magic", "dugoff")
STYLES = ("lively", "ordinary", "slow", "fast")


@dataclass(frozen=True)
class Sensors:
    """Standard deviations of white noise, rate of the logger."""

    rate_hz: float = 50.0
    yaw_rate: float = 0.002
    accel: float = 0.05
    velocity_lat: float = 0.02
    speed: float = 0.03


@dataclass(frozen=True)
class Case:
    """One drive: a car's seed, its tyres, how it is driven, and what is concealed in it."""

    seed: int
    tyres: str = "linear"
    style: str = "lively"
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """By the name that the public contract gives them; those without a name are `OUTSIDE`."""
    sensors: Sensors = field(default_factory=Sensors)
    forces: bool = False
    """Drive and brake force are recorded."""
    max_lat_mps2: float = 5.0

    def get(self, effect: str, parameter: str, default: float = 0.0) -> float:
        """Return a concealed value, or the default."""
        return float(self.effects.get(effect, {}).get(parameter, default))


OUTSIDE: dict[str, dict[str, float]] = {
    "steering_play": {"width_rad": 0.006},
    "gyro_clipping": {"most_radps": 0.22},
    "stability_control": {"gain_nms": 12.0, "beyond_radps": 0.03},
    "one_sided_grip": {"left": 0.12},
    "speed_moment": {"per_speed2": 6e-4},
    "slip_drag": {"coefficient": 0.8},
    "column_hysteresis": {"width_rad": 0.003, "lag_s": 0.04},
    "trailer": {"share": 0.04, "length_m": 4.0},
    "warming_tyres": {"loss": 0.2, "time_s": 50.0},
    "active_flap": {"per_speed2": 3e-5, "beyond_mps2": 1.0},
    "rear_axle_steering": {"coefficient": 0.06},
    "variable_steering_ratio": {"coefficient": 4.0},
}
"""Physics of no name in the catalogue. In order: play of the steering at the road wheels; a gyro that clips;
a yaw moment over the yaw inertia against yaw rates that leave the linear car's by more than a threshold;
cornering stiffness that differs in left and right bends; a yaw moment over the yaw inertia with the square of
speed; drag by side slip; a steering column that twists: play, then a lag; the lateral pull of a trailer at
its hitch, which follows the car with a length; tyres that soften as they warm up; flaps that turn the car
with the square of speed from a lateral acceleration on; rear wheels that turn with the front ones, which has
a name since it was seen here; a rack whose ratio changes with its angle."""


@dataclass(frozen=True)
class Car:
    """A car as its maker states it."""

    mass: float
    inertia: float
    front: float
    rear: float
    height: float
    track: float
    stiff_front: float
    stiff_rear: float
    friction: float
    driven: str
    ratio: float

    @property
    def base(self) -> float:
        """Return the wheelbase."""
        return self.front + self.rear


@dataclass(frozen=True)
class Recorded:
    """What a driver hands over."""

    case: Case
    car: Car
    columns: dict[str, Array]
    vehicle: str


def drawn_car(rng: np.random.Generator) -> Car:
    """Return a car between a small one and a van; some oversteer."""
    size = rng.uniform(0.0, 1.0)
    mass = 900.0 + 2600.0 * size * rng.uniform(0.75, 1.0)
    base = float(np.clip(2.3 + 1.7 * size + rng.normal(0.0, 0.08), 2.3, 4.0))
    on_front = rng.uniform(0.42, 0.62)
    front = base * (1.0 - on_front)
    # stiffness over load, 1/rad; the rear over the front decides on understeer
    per_load = rng.uniform(10.0, 18.0)
    rear_over_front = rng.uniform(0.92, 1.35)
    return Car(
        mass=mass,
        inertia=mass * front * (base - front) * rng.uniform(0.85, 1.1),
        front=front,
        rear=base - front,
        height=0.45 + 0.35 * size,
        track=1.4 + 0.3 * size,
        stiff_front=per_load * mass * G * on_front,
        stiff_rear=per_load * rear_over_front * mass * G * (1.0 - on_front),
        friction=rng.uniform(0.85, 1.05),
        driven=str(rng.choice(["front", "rear"])),
        ratio=rng.uniform(13.0, 19.0),
    )


def drives(cases: Sequence[Case], duration_s: float = 240.0) -> list[Recorded]:
    """Return the drive of each case; all are integrated side by side."""
    rngs = [np.random.default_rng([case.seed, 77]) for case in cases]
    cars = [drawn_car(rng) for rng in rngs]
    plans = [plan(case, car, duration_s, rng) for case, car, rng in zip(cases, cars, rngs, strict=True)]
    steer = np.stack([one[0] for one in plans], axis=1)
    speed = np.stack([one[1] for one in plans], axis=1)
    truth = _Fleet(cases, cars).run(steer, speed)
    return [
        Recorded(
            case,
            car,
            _recorded(case, car, steer[:, k], {n: v[:, k] for n, v in truth.items()}, rng),
            _toml(car),
        )
        for k, (case, car, rng) in enumerate(zip(cases, cars, rngs, strict=True))
    ]


# -- the driver ----------------------------------------------------------------------------------------------


def plan(case: Case, car: Car, duration_s: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the road-wheel angle that the steering wheel asks for, and the speed, every step."""
    n = round(duration_s / STEP_S)
    t = np.arange(n) * STEP_S
    low, high = {"slow": (4.5, 14.0), "ordinary": (7.0, 25.0), "lively": (9.0, 31.0), "fast": (20.0, 44.0)}[
        case.style
    ]
    # an oversteering car is kept below its critical speed
    under = car.mass * (car.rear / car.stiff_front - car.front / car.stiff_rear) / car.base
    if under < 0.0:
        high = min(high, 0.75 * math.sqrt(car.base / -under))
        low = min(low, 0.7 * high)
    at = np.concatenate([[0.0], np.cumsum(rng.uniform(4.0, 11.0, math.ceil(duration_s / 4.0)))])
    speed = _rounded(np.interp(t, at, rng.uniform(low, high, len(at))), 1.2)
    most = case.max_lat_mps2 * (0.5 if case.style in ("ordinary", "slow") else 1.0)
    lat = np.zeros(n)
    begin = 1.5
    while begin < duration_s - 6.0:
        size, last = most * rng.uniform(0.25, 1.0) * rng.choice([-1.0, 1.0]), rng.uniform(2.0, 6.0)
        rows = slice(round(begin / STEP_S), round((begin + last) / STEP_S))
        x = (t[rows] - begin) / last
        kind = rng.integers(4)
        shapes = (
            np.minimum(np.minimum(6.0 * x, 1.0), 6.0 * (1.0 - x)),
            np.sin(2.0 * math.pi * x) * np.minimum(8.0 * (1.0 - x), 1.0),
            0.6 * np.sin(2.0 * math.pi * (1.0 + 3.0 * x) * x * last * 0.25) * np.sin(math.pi * x),
            x * (1.0 - x) * 4.0,
        )
        lat[rows] += size * shapes[int(kind)]
        begin += last + rng.exponential(0.6 if case.style == "lively" else 2.0)
    lat = _rounded(lat, 0.1)
    steer = lat * (car.base / np.maximum(speed, 4.0) ** 2 + max(under, -2e-4))
    steer = np.clip(steer, -0.35, 0.35)
    return steer + 0.0015 * _rounded(rng.standard_normal(n) * 12.0, 0.25), speed


def _rounded(x: Array, time_s: float) -> Array:
    """Return x through three moving means."""
    k = max(round(time_s / STEP_S), 1)
    for _ in range(3):
        total = np.cumsum(np.pad(x, (k - k // 2, k // 2), mode="edge"))
        x = (total[k:] - total[:-k]) / k
    return x


# -- the cars ------------------------------------------------------------------------------------------------


class _Fleet:
    """Equations of motion of all cars; each value is an array (N,), wheels fl fr rl rr are (4, N)."""

    def __init__(self, cases: Sequence[Case], cars: Sequence[Car]) -> None:
        def of(name: str) -> Array:
            return np.array([getattr(car, name) for car in cars])

        def hidden(effect: str, parameter: str, default: float = 0.0) -> Array:
            return np.array([case.get(effect, parameter, default) for case in cases])

        self.hidden = hidden
        moved = hidden("cg_position_error", "forward_m")
        self.stated = [of(name) for name in ("mass", "front", "rear", "stiff_front", "stiff_rear")]
        self.a, self.b = of("front") - moved, of("rear") + moved
        self.m = of("mass") * (1.0 + hidden("mass_error", "relative"))
        self.iz = of("inertia") * (1.0 + hidden("yaw_inertia_error", "relative"))
        self.h = of("height") + hidden("cg_height_error", "height_m")
        self.track = of("track")
        self.cf = of("stiff_front") * (1.0 + hidden("cornering_stiffness_error", "front"))
        self.cr = of("stiff_rear") * (1.0 + hidden("cornering_stiffness_error", "rear"))
        limit = hidden("tyre_saturation", "friction", math.nan)
        self.mu = np.where(np.isfinite(limit), limit, of("friction"))
        self.front_driven = np.array([car.driven == "front" for car in cars])
        self.tyres = np.array([TYRES.index(case.tyres) for case in cases])
        self.length = hidden("tyre_relaxation", "length_m")
        self.loss = hidden("load_dependent_stiffness", "coefficient")
        self.roll_steer = hidden("roll_steer", "coefficient")
        self.give = hidden("compliance_steer", "coefficient")
        self.camber = hidden("camber_thrust", "coefficient")
        self.drag = hidden("aero_drag", "drag_area_m2")
        self.rolling = hidden("rolling_resistance", "coefficient")
        self.wind = [hidden("side_wind", name) for name in ("speed_mps", "onset_s", "duration_s")]
        self.bank = hidden("road_bank", "amplitude_rad")
        self.rear_share = hidden("rear_axle_steering", "coefficient")
        self.control = [hidden("stability_control", name) for name in ("gain_nms", "beyond_radps")]
        self.one_sided = hidden("one_sided_grip", "left")
        self.speed_moment = hidden("speed_moment", "per_speed2")
        self.slip_drag = hidden("slip_drag", "coefficient")
        self.trailer = hidden("trailer", "share"), hidden("trailer", "length_m", 1.0)
        self.warm = hidden("warming_tyres", "loss"), hidden("warming_tyres", "time_s", 1.0)
        self.flap = hidden("active_flap", "per_speed2"), hidden("active_flap", "beyond_mps2")

    def run(self, steer: Array, speed: Array) -> dict[str, Array]:
        """Return the truth every step, (n, N) each."""
        acting = self._at_the_wheels(steer)
        n, count = steer.shape
        names = ("v", "r", "u", "ay", "ax", "r_rate", "drive", "brake")
        out = {name: np.zeros((n, count)) for name in names}
        wanted = np.gradient(speed, STEP_S, axis=0)
        x = np.zeros((6, count))
        x[2] = speed[0]
        for k in range(n):
            ahead = min(k + 1, n - 1)
            ask = self.stated[0] * (wanted[k] + 0.7 * (speed[k] - x[2]))
            now, more = self._rates(k * STEP_S, x, acting[k], ask)
            then, _ = self._rates(ahead * STEP_S, x + STEP_S * now, acting[ahead], ask)
            for name, value in zip(
                names, (*x[:3], *more, now[1], np.maximum(ask, 0.0), np.maximum(-ask, 0.0)), strict=True
            ):
                out[name][k] = value
            x = x + 0.5 * STEP_S * (now + then)
        return out

    def _at_the_wheels(self, steer: Array) -> Array:
        """Return the angle of the road wheels, (n, N), from the one that the steering wheel asks for."""
        late = np.rint(self.hidden("steering_delay", "delay_s") / STEP_S).astype(int)
        out = np.stack([np.roll(steer[:, k], late[k]) for k in range(steer.shape[1])], axis=1)
        out = (out - self.hidden("steering_offset", "road_rad")) / self.hidden(
            "steering_ratio_error", "ratio", 1.0
        )
        out = out * (1.0 + self.hidden("variable_steering_ratio", "coefficient") * np.abs(out))
        half = 0.5 * (
            self.hidden("steering_play", "width_rad") + self.hidden("column_hysteresis", "width_rad")
        )
        if np.any(half > 0.0):
            followed = out[0].copy()
            for k in range(len(out)):
                followed = np.clip(followed, out[k] - half, out[k] + half)
                out[k] = followed
        lag = self.hidden("column_hysteresis", "lag_s")
        if np.any(lag > 0.0):
            share = np.where(lag > 0.0, 1.0 - np.exp(-STEP_S / np.maximum(lag, 1e-6)), 1.0)
            for k in range(1, len(out)):
                out[k] = out[k - 1] + share * (out[k] - out[k - 1])
        return np.asarray(out)

    def _rates(self, t: float, x: Array, delta: Array, ask: Array) -> tuple[Array, tuple[Array, Array]]:
        """Return the rates of v, r, u, both axles' slip angles and a trailer's yaw rate, and specific forces
        across and along."""
        v, r, u = x[0], x[1], np.maximum(x[2], 2.0)
        lat = u * r
        angle_f = delta - np.arctan((v + self.a * r) / u)
        angle_r = self.rear_share * delta - np.arctan((v - self.b * r) / u) + self.roll_steer * lat
        angle_f = angle_f / (1.0 + self.give * (self.a + self.b) / (self.m * self.b) * self.cf)
        lag = np.maximum(self.length, 1e-3)
        soft = self.length > 0.0
        rate_f, rate_r = (
            np.where(soft, (now - then) * u / lag, 0.0) for now, then in ((angle_f, x[3]), (angle_r, x[4]))
        )
        angle_f, angle_r = np.where(soft, x[3], angle_f), np.where(soft, x[4], angle_r)
        pull = np.where(ask > 0.0, np.where(self.front_driven, 1.0, 0.0), 0.65) * ask
        (side_f, side_r), along, twist = self._tyre_forces(
            np.stack([angle_f, angle_r]), np.stack([pull, ask - pull]), lat, ask
        )
        pull = along[0]
        grip = np.where(r > 0.0, 1.0 - self.one_sided, 1.0)
        grip = grip * (1.0 - self.warm[0] * (1.0 - np.exp(-t / self.warm[1])))
        side_f, side_r = side_f * grip, side_r * grip
        lean = self.camber * lat / G
        side_f = side_f - lean * self.m * G * self.b / (self.a + self.b)
        side_r = side_r - lean * self.m * G * self.a / (self.a + self.b)
        speed, onset, last = self.wind
        gust = np.where((t >= onset) & (t < onset + last), 0.5 * RHO * 4.5 * u * speed, 0.0)
        force_y = side_f * np.cos(delta) + pull * np.sin(delta) + side_r + gust
        moment = self.a * (side_f * np.cos(delta) + pull * np.sin(delta)) - self.b * side_r + 0.25 * gust
        moment = moment + 0.5 * self.track * twist
        moment = moment + self.iz * (
            self.speed_moment * u * u * np.tanh(20.0 * r) - self._control(delta, u, r)
        )
        # the hitch is a wheelbase behind the centre of gravity
        hitch = -self.trailer[0] * self.m * u * x[5]
        force_y, moment = force_y + hitch, moment - (self.a + self.b) * hitch
        turned = np.sign(lat) * np.maximum(np.abs(lat) - self.flap[1], 0.0)
        moment = moment + self.iz * self.flap[0] * u * u * turned
        force_x = (
            ask - side_f * np.sin(delta) - 0.5 * RHO * self.drag * u * np.abs(u) - self.rolling * self.m * G
        )
        force_x = force_x - self.slip_drag * self.m * G * np.abs(v / u)
        ay, ax = force_y / self.m, force_x / self.m
        slope = self.bank * np.sin(2.0 * math.pi * t / 65.0)
        follows = (r - x[5]) * u / self.trailer[1]
        rates = (ay - lat - G * np.sin(slope), moment / self.iz, ax + v * r, rate_f, rate_r, follows)
        return np.stack(rates), (ay, ax)

    def _control(self, delta: Array, u: Array, r: Array) -> Array:
        """Return the yaw acceleration of a stability control against what leaves the linear car's."""
        gain, beyond = self.control
        mass, front, rear, cf, cr = self.stated
        base = front + rear
        wanted = u * delta / (base + mass * (rear / cf - front / cr) / base * u * u)
        apart = r - wanted
        return np.asarray(gain * np.sign(apart) * np.maximum(np.abs(apart) - beyond, 0.0))

    def _tyre_forces(self, angle: Array, pull: Array, lat: Array, ask: Array) -> tuple[Array, Array, Array]:
        """Return side and longitudinal force of each axle, (2, N), of two wheels whose loads differ, and by
        how much the right wheels pull more than the left ones."""
        base = self.a + self.b
        static = np.stack([self.m * G * self.b, self.m * G * self.a]) / base
        load = static + np.stack([-ask, ask]) * self.h / base
        part = np.clip(self.h * lat / (G * self.track), -0.45, 0.45)
        stiff = 0.5 * np.stack([self.cf, self.cr]) * (1.0 - self.loss * (2.0 * part) ** 2)
        side = np.stack([-part, part])[:, None]
        limit = np.maximum(self.mu * load * (0.5 + side), 50.0)
        limit = limit * np.sqrt(1.0 - np.clip(0.5 * pull / limit, -0.95, 0.95) ** 2)
        linear = np.broadcast_to(stiff * angle, limit.shape)
        # parabolic pressure: F = C t - C^2 |t| t / 3 L + C^3 t^3 / 27 L^2, L = mu F_z, below 3 L / C
        third = np.clip(stiff * np.tan(angle) / (3.0 * limit), -1.0, 1.0)
        brush = limit * third * (3.0 - 3.0 * np.abs(third) + third * third)
        # shape 1.3, curvature -0.5; its slope at the origin is the stiffness
        b = linear / (1.3 * limit)
        magic = limit * np.sin(1.3 * np.arctan(b + 0.5 * (b - np.arctan(b))))
        # the lateral transfer of the mass that the axle carries at rest
        most = self.mu * np.maximum(0.5 * load + static * side, 0.0)
        dugoff, along = _dugoff(stiff * np.tan(angle), 0.5 * pull, 8.0 * self.stated[0] * G, most)
        slides = self.tyres == TYRES.index("dugoff")
        along = np.where(slides, along, 0.5 * pull)
        side_forces = np.choose(self.tyres, [linear, brush, magic, dugoff]).sum(axis=0)
        return side_forces, along.sum(axis=0), (along[1] - along[0]).sum(axis=0)


def _dugoff(side: Array, pull: Array, stiffness: Array, limit: Array) -> tuple[Array, Array]:
    """Return side and longitudinal force of wheels by the linear side force.

    The wheel slips by s, s / (1 + s) = F_x / C; both forces share the limit.
    """
    slip = pull / (stiffness - pull)
    reach = limit * (1.0 + slip) / (2.0 * np.maximum(np.hypot(side, stiffness * slip), 1e-6))
    share = np.where(reach < 1.0, (2.0 - reach) * reach, 1.0)
    return np.asarray(side / (1.0 + slip) * share), np.asarray(pull * share)


# -- the instruments -----------------------------------------------------------------------------------------


def _recorded(
    case: Case, car: Car, steer: Array, truth: Mapping[str, Array], rng: np.random.Generator
) -> dict[str, Array]:
    """Return the columns that the logger writes."""
    every = round(1.0 / (case.sensors.rate_hz * STEP_S))
    rows = np.arange(round(1.0 / STEP_S), len(steer), every)

    def late(values: Array, effect: str) -> Array:
        return np.asarray(values[rows - round(case.get(effect, "delay_s") / STEP_S)])

    def noisy(values: Array, std: float) -> Array:
        return values + std * rng.standard_normal(len(rows))

    ahead, turn = case.get("accelerometer_position", "forward_m"), case.get("accelerometer_tilt", "yaw_rad")
    across = truth["ay"] + ahead * truth["r_rate"]
    along = truth["ax"] - ahead * truth["r"] ** 2
    yaw = late(truth["r"], "gyro_delay") * case.get("yaw_rate_scale", "scale", 1.0)
    most = case.get("gyro_clipping", "most_radps", math.inf)
    ay = late(across - turn * along, "accelerometer_delay") + case.get("accelerometer_bias", "lat_mps2")
    columns = {
        "time_s": rows * STEP_S,
        "steering_wheel_angle_rad": car.ratio * steer[rows],
        "yaw_rate_radps": np.clip(
            noisy(yaw + case.get("yaw_rate_bias", "bias"), case.sensors.yaw_rate), -most, most
        ),
        "accel_lat_mps2": noisy(ay, case.sensors.accel),
        "velocity_lat_mps": noisy(truth["v"][rows], case.sensors.velocity_lat),
        "accel_long_mps2": noisy((along + turn * across)[rows], case.sensors.accel),
        "speed_mps": noisy(truth["u"][rows], case.sensors.speed) if case.forces else truth["u"][rows],
    }
    if case.forces:
        columns |= {"drive_force_n": truth["drive"][rows], "brake_force_n": truth["brake"][rows]}
    return {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}


def _toml(car: Car) -> str:
    """Return the car's tables."""
    return f"""[vehicle]
wheel_radius_m = 0.32
track_front_m = {car.track:.4f}
track_rear_m = {car.track:.4f}
wheelbase_m = {car.base:.6f}
driven_axle = "{car.driven}"
steering_ratio = {car.ratio:.6f}

[dynamics]
mass_kg = {car.mass:.3f}
yaw_inertia_kgm2 = {car.inertia:.3f}
cg_to_front_m = {car.front:.6f}
cg_to_rear_m = {car.rear:.6f}
cg_height_m = {car.height:.4f}
cornering_stiffness_front_n_per_rad = {car.stiff_front:.2f}
cornering_stiffness_rear_n_per_rad = {car.stiff_rear:.2f}
longitudinal_stiffness_n = {8.0 * car.mass * G:.1f}
friction = {car.friction:.4f}
brake_front_share = 0.65
"""
