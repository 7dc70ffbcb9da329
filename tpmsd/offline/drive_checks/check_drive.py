"""Checks of a configuration against a drive: what `tpmsd check --drive` reports.

In: the configuration, its DBC, frames and fixes. Out: `Suspicion`s with key, probability and what to write
instead. Each is a test of one statement of the file, on the same regressions that `discover` rests on. Its
probability is that of the other hypothesis against the stated one, with floors for what a right file may be
off by.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cantools.database.can import Database

from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import BusLog, MessageLog
from tpmsd.offline.discovery.prepared_log import PreparedLog, prepare
from tpmsd.offline.discovery.series import MessageField, Series, as_count, as_value
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.wheels import followers, with_positions
from tpmsd.offline.drive_checks.clock import align_fixes
from tpmsd.offline.drive_checks.configured import configured_fields, configured_frames
from tpmsd.offline.drive_checks.scales import wrong_moduli, wrong_scale
from tpmsd.offline.drive_checks.sides import car_suspicions, wrong_sides
from tpmsd.offline.drive_checks.suspicion import Suspicion
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED
from tpmsd.onboard.sources.events import GnssFix


def suspicions(
    config: Config,
    database: Database,
    log: BusLog,
    fixes: Sequence[GnssFix],
    settings: Settings = SETTINGS,
) -> list[Suspicion]:
    """Return all suspicions, the most probable first; of several of the same key and kind the most
    probable.
    """
    found: list[Suspicion] = []
    fields = configured_fields(config, database, log)
    frames = configured_frames(config, database, log, fields)
    for role, one in fields.items():
        if role not in frames:
            number = one.key & (1 << BUS_SHIFT) - 1 & ~EXTENDED
            what = f"no frame of {one.message} (identifier {number:#05x}) in the drive"
            key = f"can.signals.{role}"
            found.append(Suspicion(key, "message_never_seen", 0.999, f"{what}: wrong DBC or bus?"))
    shifted, offset = align_fixes(config, fields, frames, fixes)
    if offset is not None:
        found.append(offset)
    material = prepare(log, shifted, database, settings)
    found += _wheel_suspicions(
        config, _configured_series(fields, frames, material.reference.edge_s), material, settings
    )
    surest: dict[tuple[str, str], Suspicion] = {}
    for one_said in sorted(found, key=lambda one: -one.probability):
        surest.setdefault((one_said.key, one_said.suspicion), one_said)
    return list(surest.values())


def _configured_series(
    fields: Mapping[str, MessageField], frames: Mapping[str, MessageLog], edges: FloatArray
) -> dict[str, Series]:
    """Return a mapping role -> its readings over the cells; roles that stay the same or cannot be read are
    left out."""
    read = {}
    for role, log in frames.items():
        raw = log.bits(fields[role].layout)
        if len(raw) < 20 or raw.min() == raw.max():
            continue
        made = (as_count if role.startswith("wheel_count_") else as_value)(fields[role], log, raw, edges)
        if made is not None:
            read[role] = made
    return read


def _wheel_suspicions(
    config: Config, read: Mapping[str, Series], material: PreparedLog, settings: Settings
) -> list[Suspicion]:
    """Return the suspicions about the wheels, and where both rear ones are read about the car."""
    series = {role: made for role, made in read.items() if role.startswith("wheel_")}
    found = wrong_moduli(series)
    following = {
        role: one_found
        for role, made in series.items()
        for one_found in followers([made], material.reference, settings)
    }
    for role, one_follower in following.items():
        wrong = wrong_scale(config, role, one_follower)
        if wrong is not None:
            found.append(wrong)
    by_wheel = {role[-2:]: role for role in following}
    members = with_positions(list(following.values()), material.reference, material.gyro, settings)
    by_position = {role[-2:]: one for role, one in zip(following, members, strict=True)}
    found += wrong_sides(by_wheel, by_position)
    if {"rl", "rr"} <= by_position.keys():
        found += car_suspicions(config, by_wheel, by_position, read, material, settings)
    return found
