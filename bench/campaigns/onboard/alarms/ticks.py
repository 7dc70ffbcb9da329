"""Ticks of a drive, straight from the frames and fixes that a folder would hold.

In: `Drive`. Out: the `Tick`s that decoder, assembler and timeline make of the folder, but for what numbers
lose as text. Twice as fast as that way, because whole drives are made at once; for wheels that stand or spin
alone the decoder's judgement is needed, and the folder must be read (`surfaces.FRAMES_NEEDED`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bench.worlds.folder import HEIGHT, LATITUDE, Message, inertial_messages, wheel_messages
from bench.worlds.instruments import Drive
from bench.worlds.magic_tyre import Array
from tpmsd.onboard.sources.gnss.noise import position_std
from tpmsd.onboard.timeline.plausible import implausible_wheels
from tpmsd.onboard.timeline.tick import Fix, Tick
from tpmsd.onboard.timeline.timeline import FIELDS

DT_S = 0.1
HDOP = 0.8
KNOT_MPS = 0.514444444
MINUTE_M = 1852.0
WHEELS = ("fl", "fr", "rl", "rr")


def ticks_of(drive: Drive) -> list[Tick]:
    """All ticks of 0.1 s."""
    messages = wheel_messages(drive)
    last = min(float(message.time_s[-1]) for message in messages)
    edges: Array = np.arange(round(last / DT_S), dtype=np.float64) * DT_S
    rotation = np.diff(_angles(drive, messages, edges), axis=0)
    quantum = 2 * math.pi / drive.spec.teeth if drive.spec.wheel_signal == "counts" else 0.0
    std = np.where(np.isfinite(rotation), quantum / math.sqrt(6.0), math.nan)
    reported = _inertial(inertial_messages(drive), edges)
    fixes = _fixes(drive, edges)
    out = []
    for k in range(len(rotation)):
        end = drive.start_s + float(edges[k + 1])
        for wheel in implausible_wheels(rotation[k].tolist(), DT_S):
            rotation[k, wheel] = std[k, wheel] = math.nan
        known: dict[str, Any] = {name: float(values[k]) for name, values in reported.items()}
        out.append(
            Tick(
                index=k + 1,
                time_s=end,
                dt_s=DT_S,
                rotation_rad=rotation[k],
                rotation_std_rad=std[k],
                fixes=fixes.get(k, ()),
                host_time_s=end,
                **known,
            )
        )
    return out


def _angles(drive: Drive, messages: list[Message], edges: Array) -> Array:
    """(n, 4) angles at the edges of the ticks; NaN where no two readings enclose one."""
    out = np.empty((len(edges), 4))
    for message in messages:
        for column, (role, _, factor, _) in enumerate(message.signals):
            raw = message.raw[:, column].astype(float)
            if role.startswith("wheel_count"):
                angle = raw * factor * 2 * math.pi / drive.spec.teeth
            else:
                omega = raw * factor / 3.6 / drive.spec.configured_radius_m
                steps = 0.5 * (omega[1:] + omega[:-1]) * np.diff(message.time_s)
                angle = np.concatenate([[0.0], np.cumsum(steps)])
            wheel = WHEELS.index(role[-2:])
            out[:, wheel] = np.interp(edges, message.time_s, angle, left=math.nan, right=math.nan)
    return out


def _inertial(messages: list[Message], edges: Array) -> dict[str, Array]:
    """Means of the optional signals over each tick."""
    out = {}
    for message in messages:
        tick = np.searchsorted(edges, message.time_s, side="left") - 1
        inside = (tick >= 0) & (tick < len(edges) - 1)
        number = np.bincount(tick[inside], minlength=len(edges) - 1)
        for column, (role, _, factor, _) in enumerate(message.signals):
            values = message.raw[inside, column] * factor
            total = np.bincount(tick[inside], weights=values, minlength=len(edges) - 1)
            with np.errstate(invalid="ignore"):
                out[FIELDS[role]] = total / number
    return out


def _fixes(drive: Drive, edges: Array) -> dict[int, tuple[Fix, ...]]:
    """Fixes by tick, rounded as their sentences are."""
    spec = drive.spec
    unit = MINUTE_M * 10.0**-spec.place_digits
    across = unit * math.cos(math.radians(LATITUDE))
    lag = drive.fix_lag_s
    usual = float(np.quantile(lag, 0.15)) if len(lag) else 0.0
    valid = drive.fix_true_s + usual
    east, north = np.round(drive.fix_east / across) * across, np.round(drive.fix_north / unit) * unit
    speed = np.round(drive.fix_speed / KNOT_MPS, spec.speed_digits) * KNOT_MPS
    heading = np.radians(np.round(np.degrees(drive.fix_course_math), spec.course_digits))
    up = np.round(HEIGHT + drive.fix_up, 2)
    tick = np.searchsorted(edges, valid, side="left") - 1
    std = position_std(1, HDOP)
    out: dict[int, tuple[Fix, ...]] = {}
    for i, k in enumerate(tick.tolist()):
        if not 0 <= k < len(edges) - 1:
            continue
        fix = Fix(
            time_s=drive.start_s + float(valid[i]),
            fraction=min(max((float(valid[i]) - float(edges[k])) / DT_S, 0.0), 1.0),
            east_m=float(east[i]),
            north_m=float(north[i]),
            position_std_m=std,
            up_m=float(up[i]),
            speed_mps=float(speed[i]),
            heading_rad=float(heading[i]),
            quality=1,
            arrival_lag_s=float(lag[i]) - usual,
        )
        out[k] = (*out.get(k, ()), fix)
    return out
