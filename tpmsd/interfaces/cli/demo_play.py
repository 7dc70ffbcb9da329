"""A simulated drive, played live to a daemon in the same process.

In: a `SimulatedDrive`. Out: what the daemon did with it. No kernel support is needed: the bus is
python-can's `virtual` one, the receiver a pseudo terminal. The player has a thread of its own, as a car
has; the daemon has the caller's.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from pathlib import Path

import can

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import DEFAULT_METHOD
from tpmsd.offline.simulator.drive import SimulatedDrive
from tpmsd.offline.simulator.live import LivePlayer, PtyPort
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.daemon.recorder import DriveRecorder
from tpmsd.onboard.pipeline import Step
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sources.can.decoder import load_database

GRACE_REAL_S = 0.1
"""A frame may be this late in real time: the player shares the interpreter with the daemon."""


def watch_live(
    drive: SimulatedDrive,
    folder: Path,
    *,
    speed_up: float,
    channel: str,
    duration_s: float = math.inf,
    record: Path | None = None,
    method: str = DEFAULT_METHOD,
    on_start: Callable[[Clock, Daemon], None] = lambda clock, daemon: None,
    on_step: Callable[[Step], None] | None = None,
    grace_real_s: float = GRACE_REAL_S,
    log: logging.Logger | None = None,
) -> Daemon:
    """Play a drive on the virtual bus `channel` and a pseudo terminal to a daemon, which is returned.

    `folder` takes the daemon's configuration, socket and state; `method`: its estimator. Drive and daemon
    share one scaled clock: frames bear the drive's own times, sentences are stamped when they are read.
    """
    with (
        PtyPort() as port,
        can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as bus,
    ):
        text = drive.configuration("virtual", channel, port.path)
        text += f'\n[filter]\nmethod = "{method}"\n'
        text += '\n[status]\nsocket = "status.sock"\n\n[state]\nfile = "state.json"\n'
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "vehicle.toml").write_text(text, encoding="utf-8")
        (folder / "bus.dbc").write_text(drive.dbc, encoding="utf-8")
        config = load_config(folder)
        player = LivePlayer(drive, bus, port, speedup=speed_up)
        player.start()
        try:
            while player.now() == player.start_host_s:
                time.sleep(0.001)
            clock = Clock(speed_up, start_s=player.now())
            daemon = Daemon(
                config,
                load_database(config.can.dbc),
                clock,
                Notifier(None),
                recorder=None if record is None else DriveRecorder(record, config),
                on_step=on_step,
                frame_time=lambda stamp_s: stamp_s,
                grace_s=grace_real_s * speed_up,
                log=log,
            )
            on_start(clock, daemon)
            daemon.run(min(duration_s, drive.spec.duration_s))
        finally:
            player.stop()
            player.join(5.0)
        return daemon
