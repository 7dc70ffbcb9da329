"""What counters and receiver make of the drive: ticks for the estimators, and the truth beside them.

In: a scenario, a receiver, a seed. Out: `Driven`. Written apart from the estimators: of the program only the
record types are used. A count is the floor of the angle; the road adds a random walk to each wheel's way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from bench.worlds.paper_route import STEP_S, Route, paper_route
from tpmsd.onboard.timeline.tick import Fix, Tick

Array = NDArray[np.float64]
TICK_S = 0.1
FIX_S = 0.2
START_S = 1_700_000_000.0
RADIUS_M = 0.316
TEETH = 48
QUANTUM_RAD = 2 * math.pi / TEETH
ROUGHNESS_M = 3e-4
"""Standard deviation of a wheel's way per square root of a metre."""
K2 = 5808
"""Tick at which the slow puncture is complete, eq. (40)."""
PUNCTURE_M = -2.5e-3
UNBALANCED_M = -1.5e-3
STATED_STD_M = 1.5
"""What the receiver says of itself, whatever is true."""
GROWTH_S2PM = 9.2e-7
"""Of a radius with the square of the speed: 1.1 mm from 10 to 36 m/s."""
WANDER_M = 5e-5
"""Standard deviation of the radius drift of each wheel."""
WANDER_TAU_S = 240.0
FL, FR, RL, RR = range(4)


@dataclass(frozen=True)
class Scenario:
    """What the rear wheels' radii do."""

    name: str
    step_m: float = 0.0
    """Added to the left rear radius all the time."""
    ramp_m: float = 0.0
    """Reached by the right rear radius at tick K2, eq. (40) with its sign put right."""
    lively: bool = False
    """Whether the radii also do what those of real cars do: grow with speed, and drift."""


SCENARIOS = {
    each.name: each
    for each in (
        Scenario("balanced"),
        Scenario("unbalanced", step_m=UNBALANCED_M),
        Scenario("puncture", ramp_m=PUNCTURE_M),
        Scenario("lively", ramp_m=PUNCTURE_M, lively=True),
    )
}


@dataclass(frozen=True)
class Errors:
    """Standard deviations and memories of one drawn receiver."""

    white_m: float
    slow_m: float
    slow_tau_s: float
    doppler_mps: float
    doppler_tau_s: float
    """0: new with every fix."""


def draw_errors(receiver: str, rng: np.random.Generator) -> Errors:
    """`white`: the paper's assumption (10d). `correlated`: what receivers do, another one in each run."""
    if receiver == "white":
        return Errors(STATED_STD_M, 0.0, 1.0, 0.1, 0.0)
    if receiver != "correlated":
        raise ValueError(f"no receiver {receiver!r}")
    return Errors(
        white_m=float(rng.uniform(0.1, 0.4)),
        slow_m=float(rng.uniform(0.8, 2.2)),
        slow_tau_s=float(np.exp(rng.uniform(math.log(20.0), math.log(100.0)))),
        doppler_mps=float(np.exp(rng.uniform(math.log(0.03), math.log(0.09)))),
        doppler_tau_s=float(rng.uniform(0.5, 1.5)),
    )


@dataclass(frozen=True)
class Driven:
    """A drive as its instruments had it; truth at the ends of the ticks, arrays (n, ...)."""

    scenario: Scenario
    receiver: str
    seed: int
    errors: Errors
    ticks: list[Tick]
    offsets_m: Array
    """(n, 4) true radius minus nominal."""
    pose: Array
    """(n + 1, 3) east, north, heading, from the start on."""
    speed_mps: Array
    """(n + 1,)"""
    distance_m: Array
    """(n,) of the middle of the rear axle."""
    reading_rad: Array
    """(n + 1, 4) true angle minus reading, less half a count."""


def markov(rng: np.random.Generator, count: int, step_s: float, std: float, tau_s: float) -> Array:
    """(count, 2) two independent stationary first-order processes; tau 0 is white."""
    keep = math.exp(-step_s / tau_s) if tau_s > 0.0 else 0.0
    kicks = rng.standard_normal((count, 2)) * std * math.sqrt(1.0 - keep**2)
    kicks[0] = rng.standard_normal(2) * std
    return np.asarray(lfilter([1.0], [1.0, -keep], kicks, axis=0))


def drawn_offsets(scenario: Scenario, speed_mps: Array, rng: np.random.Generator) -> Array:
    """(ticks + 1, 4): a guessed nominal radius is wrong for both rear wheels alike, by a millimetre or so."""
    ticks = speed_mps.size - 1
    out = np.zeros((ticks + 1, 4))
    out[:, [RL, RR]] = 1e-3 * rng.standard_normal()
    out[:, [FL, FR]] = 1e-3 * rng.standard_normal() + 0.4e-3 * rng.standard_normal(2)
    out[:, RL] += scenario.step_m
    out[:, RR] += scenario.ramp_m * np.minimum(np.arange(ticks + 1) / K2, 1.0)
    if scenario.lively:
        out += GROWTH_S2PM * speed_mps[:, None] ** 2
        for pair in ([FL, FR], [RL, RR]):
            out[:, pair] += markov(rng, ticks + 1, TICK_S, WANDER_M, WANDER_TAU_S)
    return out


def drive(
    scenario: Scenario,
    receiver: str,
    seed: int,
    route: Route | None = None,
    offsets_m: Array | None = None,
    added_m: Array | float = 0.0,
) -> Driven:
    """Drive the route once; everything that is random follows from the seed. `offsets_m` (n + 1, 4) replaces
    what the scenario would draw, `added_m` is added to it."""
    route = paper_route() if route is None else route
    rng = np.random.default_rng([seed, 4])
    errors = draw_errors(receiver, rng)
    every = round(TICK_S / STEP_S)
    rolled = route.rolled_m[::every]
    count = rolled.shape[0] - 1
    drawn = drawn_offsets(scenario, route.speed_mps[::every], rng)
    offsets = (drawn if offsets_m is None else offsets_m) + added_m
    distances = np.diff(rolled, axis=0)
    rough = ROUGHNESS_M * np.sqrt(np.abs(distances)) * rng.standard_normal(distances.shape)
    middle = RADIUS_M + (offsets[1:] + offsets[:-1]) / 2
    angle = np.concatenate([[rng.random(4)], (distances + rough) / middle]).cumsum(axis=0)
    shown = np.floor(angle / QUANTUM_RAD) * QUANTUM_RAD
    fixes = _fixes(route, errors, rng)
    reading = np.full(4, QUANTUM_RAD / math.sqrt(6.0))
    ticks = []
    for k in range(count):
        end = START_S + (k + 1) * TICK_S
        fix = fixes.get(k + 1)
        ticks.append(
            Tick(
                index=k + 1,
                time_s=end,
                dt_s=TICK_S,
                rotation_rad=shown[k + 1] - shown[k],
                rotation_std_rad=reading,
                fixes=() if fix is None else (fix,),
                host_time_s=end,
            )
        )
    pose = np.stack([route.east_m, route.north_m, route.heading_rad], axis=1)[::every]
    return Driven(
        scenario=scenario,
        receiver=receiver,
        seed=seed,
        errors=errors,
        ticks=ticks,
        offsets_m=offsets[1:],
        pose=pose,
        speed_mps=route.speed_mps[::every],
        distance_m=distances[:, [RL, RR]].mean(axis=1),
        reading_rad=angle - shown - QUANTUM_RAD / 2,
    )


def _fixes(route: Route, errors: Errors, rng: np.random.Generator) -> dict[int, Fix]:
    """Fix by number of the tick at whose end it is."""
    every = round(FIX_S / STEP_S)
    east, north = route.east_m[every::every], route.north_m[every::every]
    speed, heading = route.speed_mps[every::every], route.heading_rad[every::every]
    count = east.size
    slow = markov(rng, count, FIX_S, errors.slow_m, errors.slow_tau_s)
    white = errors.white_m * rng.standard_normal((count, 2))
    doppler = markov(rng, count, FIX_S, errors.doppler_mps, errors.doppler_tau_s)
    seen_east = speed * np.cos(heading) + doppler[:, 0]
    seen_north = speed * np.sin(heading) + doppler[:, 1]
    per = round(FIX_S / TICK_S)
    out = {}
    for k in range(count):
        moving = math.hypot(seen_east[k], seen_north[k])
        out[(k + 1) * per] = Fix(
            time_s=START_S + (k + 1) * FIX_S,
            fraction=1.0,
            east_m=float(east[k] + slow[k, 0] + white[k, 0]),
            north_m=float(north[k] + slow[k, 1] + white[k, 1]),
            position_std_m=STATED_STD_M,
            speed_mps=moving,
            heading_rad=math.atan2(seen_north[k], seen_east[k]) if moving > 1.0 else math.nan,
        )
    return out
