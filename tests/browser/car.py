"""A car with a daemon, as a process: `python -m tests.browser.car FOLDER ONSET_S SPEED_UP [ticks]`.

In: where configuration and socket go, when a rear left puncture begins. Out: the daemon's status socket;
each alarm is a line `RAISED <kind> <wheel> <monotonic time>` at the moment at which its frame goes onto the
bus; with `ticks`, each tick is a line `TICK <monotonic time>`.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

from tpmsd.interfaces.cli.demo_play import watch_live
from tpmsd.offline.simulator.drive import DEFAULT_VEHICLE, DriveSpec, simulate_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.onboard.pipeline import Step

NAMED = replace(DEFAULT_VEHICLE, name="The hatchback")


def say(step: Step) -> None:
    """One line per alarm that is raised, and per tick where that is wanted."""
    if "ticks" in sys.argv[4:]:
        print(f"TICK {time.monotonic()}", flush=True)
    for event in step.report.events:
        if event.state == "raised":
            print(f"RAISED {event.kind} {event.wheel} {time.monotonic()}", flush=True)


if __name__ == "__main__":
    folder, onset_s, speed_up = Path(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    fault = Fault(
        kind="puncture", size=2.5, size_unit="percent", wheel="rl", onset_s=onset_s, duration_s=10.0
    )
    drive = simulate_drive(
        DriveSpec(route="oval", duration_s=3600.0, seed=4, flat=True, faults=(fault,), vehicle=NAMED)
    )
    watch_live(drive, folder, speed_up=speed_up, channel="browser", on_step=say)
