"""The simulated GNSS receiver.

In: the world's truth, the receiver's qualities, clocks, a Generator. Out: NMEA lines with the host's arrival
times. Its position error drifts (Gauss-Markov) under a small white part, its Doppler velocity has an error
of its own with a short memory, and it loses its fix, jumps and lags as receivers do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.geodesy import GeodeticTrack, on_ellipsoid, radii_of_curvature
from tpmsd.offline.simulator.nmea import SENTENCES, Epoch, sentence
from tpmsd.offline.simulator.noise import gauss_markov
from tpmsd.offline.simulator.world import World

_JUMP_DECAY_S = 3.0


@dataclass(frozen=True)
class ReceiverSpec:
    """The receiver's qualities; standard deviations per axis."""

    rate_hz: float = 5.0
    position_std_m: float = 1.2
    position_tau_s: float = 30.0
    white_std_m: float = 0.15
    velocity_std_mps: float = 0.05
    velocity_tau_s: float = 1.0
    course_from_mps: float = 1.0
    """Speed below which the course is left empty, m/s."""
    latency_s: float = 0.06
    """Latency from validity to the first byte, s; the drive's vehicle.toml states it as known."""
    jitter_s: float = 0.004
    """Mean of the (exponential, so one-sided) transport jitter."""
    outages: tuple[tuple[float, float], ...] = ()
    """(from, to) in seconds since the drive's start without a fix."""
    outages_per_hour: float = 0.0
    outage_s: float = 15.0
    """Mean length of a random outage."""
    jumps_per_hour: float = 0.0
    """Multipath: the position jumps away and comes back over some seconds."""
    jump_m: float = 10.0
    hdop: float = 0.8
    talker: str = "GN"
    sentences: tuple[str, ...] = ("RMC", "GGA")
    baud: int = 115200
    latitude_deg: float = 50.11
    """Latitude at which the drive starts, deg."""
    longitude_deg: float = 8.68
    altitude_m: float = 160.0

    def __post_init__(self) -> None:
        if not 0.1 <= self.rate_hz <= 50.0:
            raise ConfigError(f"receiver rate {self.rate_hz:g} Hz is outside 0.1 to 50 Hz")
        for kind in self.sentences:
            if kind not in SENTENCES:
                raise ConfigError(f"unknown sentence {kind!r} (sentences: {' '.join(SENTENCES)})")


@dataclass(frozen=True, slots=True)
class NmeaLine:
    """A sentence and the host time at which its first byte arrived."""

    time_s: float
    text: str


@dataclass(frozen=True)
class Epochs:
    """Measurements of the receiver; arrays (m,) over its epochs."""

    time_s: FloatArray
    """Validity, since the drive's start."""
    east_error_m: FloatArray
    north_error_m: FloatArray
    up_error_m: FloatArray
    east_mps: FloatArray
    """Measured velocity."""
    north_mps: FloatArray
    valid: np.ndarray
    hdop: FloatArray
    track: GeodeticTrack
    """The truth at the epochs."""
    height_m: FloatArray


def measure_epochs(world: World, spec: ReceiverSpec, clocks: Clocks, rng: np.random.Generator) -> Epochs:
    """Return all epochs of the drive, at whole multiples of the receiver's period in UTC."""
    motion, antenna = world.motion, world.antenna
    period = 1.0 / spec.rate_hz
    end = float(motion.time_s[-1])
    first = np.ceil(clocks.start_utc_s * spec.rate_hz - 1e-6)
    ticks = np.arange(int(np.floor((clocks.start_utc_s + end) * spec.rate_hz + 1e-6) - first) + 1)
    time_s = np.clip((first - clocks.start_utc_s * spec.rate_hz + ticks) * period, 0.0, end)
    height = spec.altitude_m + antenna.up_m
    full = on_ellipsoid(
        motion.time_s, antenna.east_mps, antenna.north_mps, height, spec.latitude_deg, spec.longitude_deg
    )

    def at_epochs(values: FloatArray, age_s: float = 0.0) -> FloatArray:
        return np.asarray(np.interp(time_s - age_s, motion.time_s, values), dtype=np.float64)

    # Longitudes are unwrapped for the interpolation, since a drive may cross the date line.
    longitude = at_epochs(np.degrees(np.unwrap(np.radians(full.longitude_deg))))
    track = GeodeticTrack(
        at_epochs(full.latitude_deg), longitude, at_epochs(full.east_mps), at_epochs(full.north_mps)
    )
    lag = world.model.velocity_age_s()
    count = len(time_s)
    drift = gauss_markov(rng, count, period, spec.position_std_m, spec.position_tau_s, 3)
    white = spec.white_std_m * rng.standard_normal((count, 3))
    velocity = gauss_markov(rng, count, period, spec.velocity_std_mps, spec.velocity_tau_s, 2)
    error = (drift + white) * np.array([1.0, 1.0, 1.8])  # heights are worse: no satellites from below
    error[:, :2] += _position_jumps(time_s, spec, rng)
    valid = _valid_epochs(time_s, spec, rng)
    hdop = np.maximum(spec.hdop + gauss_markov(rng, count, period, 0.08, 120.0, 1)[:, 0], 0.5)
    return Epochs(
        time_s=time_s,
        east_error_m=error[:, 0],
        north_error_m=error[:, 1],
        up_error_m=error[:, 2],
        east_mps=at_epochs(full.east_mps + antenna.shown_east_mps - antenna.east_mps, lag) + velocity[:, 0],
        north_mps=at_epochs(full.north_mps + antenna.shown_north_mps - antenna.north_mps, lag)
        + velocity[:, 1],
        valid=valid,
        hdop=hdop,
        track=track,
        height_m=at_epochs(height),
    )


def nmea_lines(
    world: World, epochs: Epochs, spec: ReceiverSpec, clocks: Clocks, rng: np.random.Generator
) -> list[NmeaLine]:
    """Return the sentences in order of arrival. The epoch's first comes `latency` (and jitter) after
    validity, the others as fast as the serial line carries them; an epoch never overtakes the one before.
    """
    latitude = np.radians(epochs.track.latitude_deg)
    meridian, prime = radii_of_curvature(latitude)
    lat = epochs.track.latitude_deg + np.degrees(epochs.north_error_m / (meridian + epochs.height_m))
    east_radius = (prime + epochs.height_m) * np.cos(latitude)
    lon = epochs.track.longitude_deg + np.degrees(epochs.east_error_m / east_radius)
    lon = (lon + 180.0) % 360.0 - 180.0
    speed = np.hypot(epochs.east_mps, epochs.north_mps)
    course = np.degrees(np.arctan2(epochs.east_mps, epochs.north_mps)) % 360.0
    course[speed < spec.course_from_mps] = np.nan
    age = spec.latency_s + world.model.fix_age_s()
    jitter = rng.exponential(spec.jitter_s, len(epochs.time_s)) if spec.jitter_s > 0 else 0.0
    arrivals = world.host_s(clocks, epochs.time_s + age + jitter)
    utc = clocks.utc_s(epochs.time_s)
    altitude = epochs.height_m + epochs.up_error_m
    stated_std_m = float(np.hypot(spec.position_std_m, spec.white_std_m))
    lines: list[NmeaLine] = []
    free = -np.inf
    for k in range(len(utc)):
        valid = bool(epochs.valid[k])
        epoch = Epoch(
            utc_s=float(utc[k]),
            valid=valid,
            latitude_deg=float(lat[k]),
            longitude_deg=float(lon[k]),
            altitude_m=float(altitude[k]),
            speed_mps=float(speed[k]),
            course_deg=float(course[k]),
            hdop=float(epochs.hdop[k]),
            satellites=round(14 / float(epochs.hdop[k]) ** 0.5) if valid else 2,
            position_std_m=stated_std_m * float(epochs.hdop[k]) / spec.hdop,
        )
        when = max(float(arrivals[k]), free)
        for kind in spec.sentences:
            text = sentence(kind, epoch, spec.talker)
            lines.append(NmeaLine(when, text))
            when += 10 * (len(text) + 2) / spec.baud
        free = when
    return lines


def _position_jumps(time_s: FloatArray, spec: ReceiverSpec, rng: np.random.Generator) -> FloatArray:
    """Return the (m, 2) position errors, m, of random jumps that decay exponentially."""
    out = np.zeros((len(time_s), 2))
    for start in _random_event_times(time_s, spec.jumps_per_hour, rng):
        direction = float(rng.uniform(0, 2 * np.pi))
        size = spec.jump_m * float(rng.uniform(0.5, 1.5))
        since = time_s - start
        shape = np.where(since >= 0, np.exp(-np.maximum(since, 0.0) / _JUMP_DECAY_S), 0.0)
        out += size * shape[:, None] * np.array([np.cos(direction), np.sin(direction)])
    return out


def _valid_epochs(time_s: FloatArray, spec: ReceiverSpec, rng: np.random.Generator) -> np.ndarray:
    """Return (m,) True for epochs outside the specified and the random outages."""
    valid = np.ones(len(time_s), dtype=bool)
    random = [
        (start, start + float(rng.exponential(spec.outage_s)))
        for start in _random_event_times(time_s, spec.outages_per_hour, rng)
    ]
    for begin, end in [*spec.outages, *random]:
        valid &= (time_s < begin) | (time_s >= end)
    return valid


def _random_event_times(time_s: FloatArray, per_hour: float, rng: np.random.Generator) -> list[float]:
    """Return the sorted times of a Poisson process of `per_hour` events an hour."""
    span = float(time_s[-1] - time_s[0]) if len(time_s) else 0.0
    count = int(rng.poisson(per_hour * span / 3600.0))
    return sorted(float(time_s[0]) + float(x) for x in rng.uniform(0, span, count))
