"""Manoeuvres: short pieces of driving with chosen speeds, bends and slopes, and drives made of them.

In: manoeuvres, or a route file. Out: `ManoeuvrePart`s and the `Motion` of a car that drives them. A step
holds one curvature and one slope and changes the speed evenly; corners in time are rounded as a driver rounds
them. Random roads without chosen manoeuvres are those of `road`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.text_file import read_text
from tpmsd.foundation.toml_text import parse_toml
from tpmsd.foundation.wheels import FloatArray

ROUNDED_S = 1.5
"""Width of the Hann window that rounds speeds, bends and slopes over time."""
START_S = 4.0
"""Time of standing before setting off, s."""
TRANSFER_MPS2 = 1.2
"""Change of speed from one manoeuvre to the next."""
MAX_STEPS = 2000
MAX_BYTES = 1 << 20
"""Size of a route file, at most; `MAX_STEPS` steps take some 200 kB."""
LIMITS = {
    "duration_s": (0.5, 7200.0),
    "speed_mps": (0.0, 70.0),
    "curvature_per_m": (-0.1, 0.1),
    "slope": (-0.2, 0.2),
}


@dataclass(frozen=True, slots=True)
class ManoeuvrePart:
    """Seconds of driving with a constant curvature and slope towards a speed."""

    duration_s: float
    speed_mps: float
    """Speed at its end, m/s."""
    curvature_per_m: float = 0.0
    """Positive to the left."""
    slope: float = 0.0
    """Rise over run."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A named list of steps."""

    name: str
    steps: tuple[ManoeuvrePart, ...]

    @property
    def fastest_mps(self) -> float:
        """Greatest speed of its steps, m/s."""
        return max(step.speed_mps for step in self.steps)

    @property
    def flat(self) -> bool:
        """True if no step has a slope."""
        return all(step.slope == 0.0 for step in self.steps)


def _alternating_bends(
    speed_mps: float, lateral_mps2: float, seconds: float, times: int = 2
) -> tuple[ManoeuvrePart, ...]:
    """Return steps with the same bend to the left and to the right, `times` over."""
    bend = lateral_mps2 / speed_mps**2
    both = (
        ManoeuvrePart(seconds, speed_mps, bend),
        ManoeuvrePart(3.0, speed_mps),
        ManoeuvrePart(seconds, speed_mps, -bend),
    )
    return (ManoeuvrePart(3.0, speed_mps), *(both * times), ManoeuvrePart(3.0, speed_mps))


def _speed_cycles(
    low: float, high: float, up: float, down: float, times: int = 2
) -> tuple[ManoeuvrePart, ...]:
    """Return steps from `low` to `high` speed and back, m/s, at accelerations `up` and `down`, m/s2, `times`
    over.
    """
    rise, fall = ManoeuvrePart((high - low) / up, high), ManoeuvrePart((high - low) / down, low)
    return (
        ManoeuvrePart(2.0, low),
        *((rise, ManoeuvrePart(2.0, high), fall, ManoeuvrePart(2.0, low)) * times),
    )


LIBRARY: tuple[Manoeuvre, ...] = (
    Manoeuvre("hold 8 m/s", (ManoeuvrePart(40.0, 8.0),)),
    Manoeuvre("hold 15 m/s", (ManoeuvrePart(40.0, 15.0),)),
    Manoeuvre("hold 22 m/s", (ManoeuvrePart(40.0, 22.0),)),
    Manoeuvre("hold 30 m/s", (ManoeuvrePart(40.0, 30.0),)),
    Manoeuvre("speed up and slow down gently", _speed_cycles(8.0, 22.0, 0.8, 0.8)),
    Manoeuvre("speed up and brake firmly", _speed_cycles(6.0, 22.0, 2.0, 3.0)),
    Manoeuvre("speed up and brake firmly at 30 m/s", _speed_cycles(20.0, 30.0, 1.2, 3.0)),
    Manoeuvre("circles of 20 m at 6 m/s, both sides", _alternating_bends(6.0, 1.8, 20.0)),
    Manoeuvre("bends at 10 m/s, both sides", _alternating_bends(10.0, 2.5, 10.0)),
    Manoeuvre("bends at 20 m/s, both sides", _alternating_bends(20.0, 2.5, 10.0)),
    Manoeuvre("bends at 30 m/s, both sides", _alternating_bends(30.0, 2.0, 10.0)),
    Manoeuvre(
        "climb and descend 6 %",
        (
            ManoeuvrePart(3.0, 15.0),
            ManoeuvrePart(40.0, 15.0, slope=0.06),
            ManoeuvrePart(40.0, 15.0, slope=-0.06),
            ManoeuvrePart(3.0, 15.0),
        ),
    ),
    Manoeuvre(
        "crests and dips",
        (
            ManoeuvrePart(3.0, 15.0),
            *((ManoeuvrePart(4.0, 15.0, slope=0.08), ManoeuvrePart(4.0, 15.0, slope=-0.08)) * 5),
            ManoeuvrePart(3.0, 15.0),
        ),
    ),
    Manoeuvre(
        "there and back",
        (
            ManoeuvrePart(30.0, 15.0),
            ManoeuvrePart(4.0, 8.0),
            ManoeuvrePart(31.4, 8.0, 0.0125),
            ManoeuvrePart(4.0, 15.0),
            ManoeuvrePart(30.0, 15.0),
        ),
    ),
    Manoeuvre(
        "stand for a minute", (ManoeuvrePart(6.0, 0.0), ManoeuvrePart(60.0, 0.0), ManoeuvrePart(6.0, 8.0))
    ),
    Manoeuvre("drive on for five minutes at 22 m/s", (ManoeuvrePart(300.0, 22.0),)),
)


def steps_of(manoeuvres: Sequence[Manoeuvre]) -> tuple[ManoeuvrePart, ...]:
    """Return the steps of manoeuvres one after the other, with the changes of speed between them."""
    out = [ManoeuvrePart(START_S, 0.0)]
    for one in manoeuvres:
        first = one.steps[0].speed_mps
        change = abs(first - out[-1].speed_mps)
        if change > 0.0 and first > 0.0:
            out.append(ManoeuvrePart(max(change / TRANSFER_MPS2, 0.5), first))
        out += one.steps
    return tuple(out)


def motion_of(steps: Sequence[ManoeuvrePart], wheelbase_m: float, rate_hz: float = 100.0) -> Motion:
    """Return the motion of a car that drives these steps from a standstill, at `rate_hz`."""
    ends = np.cumsum([step.duration_s for step in steps])
    count = int(ends[-1] * rate_hz) + 1
    half = max(round(ROUNDED_S * rate_hz / 2), 1)
    time_s = np.arange(count) / rate_hz
    wide = np.arange(-half, count + half) / rate_hz
    window = np.hanning(2 * half + 3)[1:-1]

    def smoothed(values: FloatArray) -> FloatArray:
        return np.asarray(np.convolve(values, window / window.sum(), mode="valid"))

    which = np.minimum(np.searchsorted(ends, wide, side="right"), len(steps) - 1)
    speed = smoothed(
        np.interp(wide, np.concatenate([[0.0], ends]), [0.0, *(step.speed_mps for step in steps)])
    )
    bend = smoothed(np.array([step.curvature_per_m for step in steps])[which])
    slope = smoothed(np.array([step.slope for step in steps])[which])
    return Motion.from_profiles(
        time_s, np.maximum(speed, 0.0), speed * bend, wheelbase_m=wheelbase_m, grade_rad=np.arctan(slope)
    )


def format_route(manoeuvres: Sequence[Manoeuvre]) -> str:
    """Return a route file; `parse_route` reads it back."""
    lines = ["# a drive of manoeuvres, for: tpmsd simulate OUT --route-file FILE"]
    for one in manoeuvres:
        lines += ["", "[[manoeuvre]]", f'name = "{one.name}"', "steps = ["]
        for step in one.steps:
            values = ", ".join(f"{name} = {getattr(step, name)!r}" for name in LIMITS)
            lines.append(f"    {{ {values} }},")
        lines.append("]")
    return "\n".join(lines) + "\n"


def load_route(path: Path) -> tuple[ManoeuvrePart, ...]:
    """Return the steps of a route file; ConfigError with file and reason where it is none."""
    text = read_text(path, MAX_BYTES, "a route")
    try:
        return steps_of(parse_route(text))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def parse_route(text: str) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres of a route file; ConfigError with the reason where it is none."""
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise ConfigError(f"not TOML: {error}") from None
    entries = table.get("manoeuvre")
    if not isinstance(entries, list) or not entries or set(table) != {"manoeuvre"}:
        raise ConfigError("a route file holds [[manoeuvre]] tables and nothing else")
    out = []
    for number, entry in enumerate(entries, 1):
        if not isinstance(entry, dict) or not isinstance(entry.get("steps"), list) or not entry["steps"]:
            raise ConfigError(f"manoeuvre {number} has no list of steps")
        steps = tuple(_read_step(step, f"manoeuvre {number}") for step in entry["steps"])
        out.append(Manoeuvre(str(entry.get("name", f"manoeuvre {number}")), steps))
    if sum(len(one.steps) for one in out) > MAX_STEPS:
        raise ConfigError(f"more than {MAX_STEPS} steps")
    return tuple(out)


def _read_step(entry: object, where: str) -> ManoeuvrePart:
    if not isinstance(entry, dict):
        raise ConfigError(f"{where}: a step is a table such as {{ duration_s = 10.0, speed_mps = 15.0 }}")
    values: dict[str, float] = {}
    for key, value in entry.items():
        if key not in LIMITS:
            raise ConfigError(f"{where}: a step has no {key!r} (it has {' '.join(LIMITS)})")
        low, high = LIMITS[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise ConfigError(f"{where}: {key} = {value!r} is no number from {low:g} to {high:g}")
        values[key] = float(value)
    for key in ("duration_s", "speed_mps"):
        if key not in values:
            raise ConfigError(f"{where}: a step without {key}")
    return ManoeuvrePart(**values)
