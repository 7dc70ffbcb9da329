"""Fixes of a receiver that sits on the bus, from the frames of a log.

In: the configuration, its DBCs, blocks of frames. Out: `GnssFix`es, as the daemon's own core gathers them.
"""

from __future__ import annotations

import numpy as np
from cantools.database.can import Database

from tpmsd.car.config.gnss_source import source_of
from tpmsd.car.config.model import GNSS_ROLES, Config
from tpmsd.onboard.sources.can.block import ERROR, REMOTE, FrameBlock
from tpmsd.onboard.sources.can.channels import bus_numbers
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED, compile_plans, signal_steps
from tpmsd.onboard.sources.events import GnssFix, InertialSample
from tpmsd.onboard.sources.gnss.on_can import CanFixAssembler


def is_on_bus(config: Config) -> bool:
    """Return whether the configured receiver sends its fixes on the bus."""
    source = source_of(config.gnss)
    return source is not None and source.kind == "can"


class BusFixes:
    """Gathers the fixes of a log, block by block."""

    def __init__(self, config: Config, database: Database) -> None:
        self._config = config
        self._decoder = CanDecoder(config, database)
        self._assembler = CanFixAssembler(config.can.signals, signal_steps(config, database))
        self._keys = [
            key
            for key, plan in compile_plans(config, database).items()
            if plan.conditions
            or any(one.role in GNSS_ROLES for group in plan.groups for one in group.signals)
        ]
        self.fixes: list[GnssFix] = []

    def decode_block(self, block: FrameBlock) -> None:
        """Decode the fixes in the frames of a block."""
        others = [bus.channel for bus in self._config.can.buses.values()]
        of_name = bus_numbers(block.channels, self._config.can.channel, others)
        bus = np.array([of_name[name] for name in block.channels], dtype=np.int64)[block.channel]
        keys = bus << BUS_SHIFT | block.identifier
        relevant = np.isin(keys, self._keys) & (block.flags & (ERROR | REMOTE) == 0)
        for index in np.flatnonzero(relevant).tolist():
            time_s, identifier = float(block.time_s[index]), int(block.identifier[index])
            events = self._assembler.advance(time_s)
            for event in self._decoder.decode(
                time_s,
                identifier & ~EXTENDED,
                bool(identifier & EXTENDED),
                block.payload(index),
                int(bus[index]),
            ):
                if isinstance(event, InertialSample) and event.role in GNSS_ROLES:
                    events += self._assembler.take(event)
            self.fixes += [event for event in events if isinstance(event, GnssFix)]

    def finish(self) -> list[GnssFix]:
        """Return all fixes, the last epoch included."""
        self.fixes += [event for event in self._assembler.flush() if isinstance(event, GnssFix)]
        return self.fixes
