"""Clocks of the fixes and of the frames: whether their stamps belong together.

In: frames as a configuration reads them, fixes. Out: the fixes on the frames' clock, and a suspicion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tpmsd.car.config.model import Config
from tpmsd.car.rings.ring import counts_per_m
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import MessageLog
from tpmsd.offline.discovery.reference import make_reference
from tpmsd.offline.discovery.series import MessageField, Series, as_count, as_value
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.offline.drive_checks.clock_offset import best_offset
from tpmsd.offline.drive_checks.suspicion import Suspicion
from tpmsd.onboard.sources.events import GnssFix


def align_fixes(
    config: Config, fields: dict[str, MessageField], frames: dict[str, MessageLog], fixes: Sequence[GnssFix]
) -> tuple[Sequence[GnssFix], Suspicion | None]:
    """Return the fixes on the frames' clock, and the suspicion if they had to be shifted."""
    reference = make_reference(fixes)
    read = None if len(reference.fix_s) < 10 else _first_read_wheel(fields, frames)
    if read is None:
        return fixes, None
    role, one, edges = read
    message = frames[role]
    per_metre = counts_per_m(config.vehicle.teeth_per_rev, config.vehicle.wheel_radius_m[2])
    speed = one.rate * abs(fields[role].scale) / (per_metre if one.kind == "count" else 3.6)
    best = best_offset(0.5 * (edges[1:] + edges[:-1]), speed, reference.fix_s, reference.fix_speed_mps)
    if best is None:
        return fixes, None
    offset_s, there, here = best
    stated = config.gnss.latency_s or 0.0
    if abs(offset_s + stated) <= SETTINGS.clocks_apart_s or there < 0.97:
        return fixes, None
    readings = (edges[-1] - edges[0]) / SETTINGS.independent_s
    if (
        math.isfinite(here)
        and 0.5 * readings * math.log((1.0 - here**2) / (1.0 - there**2)) < SETTINGS.clocks_apart_nats
    ):
        return fixes, None
    apart = fixes[0].arrival_s > message.time_s[-1] or fixes[-1].arrival_s < message.time_s[0]
    said = "the recordings do not overlap; " if apart else ""
    digits = 0 if abs(offset_s) >= 5.0 else 1
    late, shift = f"{-offset_s:+.{digits}f}", f"{offset_s:+.{digits}f}"
    suggest = f"{said}the fixes' stamps are {late} s off: shift them by {shift} s"
    moved = [replace(fix, arrival_s=fix.arrival_s + offset_s) for fix in fixes]
    return moved, Suspicion("gnss", "clock_offset", min(0.999, there), suggest)


def _first_read_wheel(
    fields: dict[str, MessageField], frames: dict[str, MessageLog]
) -> tuple[str, Series, FloatArray] | None:
    """Return role, readings and cells' edges (s) of the first wheel that was read; None without one."""
    role = next((r for r in frames if r.startswith("wheel_")), None)
    if role is None or not len(frames[role].time_s):
        return None
    message = frames[role]
    edges = np.arange(np.ceil(message.time_s[0]), message.time_s[-1], 1.0)
    if len(edges) < 3:
        return None
    made = as_count if role.startswith("wheel_count_") else as_value
    one = made(fields[role], message, message.bits(fields[role].layout), edges)
    return None if one is None else (role, one, edges)
