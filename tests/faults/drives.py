"""A drive to which something happens: simulated once, changed by each test, played through the core.

The drive is 150 s long. The radii are learned by second 62; between 65 and 90 a test may do to its frames
and sentences what it likes; at second 105 the rear left tyre loses 2 % within eight seconds. So a fault that
lets an alarm be lost, or raises a false one, shows in the list of alarms alone.
"""

from __future__ import annotations

import dataclasses
import functools
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.signal_plan import compile_plans
from tpmsd.onboard.sources.drive import FolderStream, Sentence
from tpmsd.onboard.sources.events import SourceFault

DURATION_S = 150.0
FROM_S, TO_S = 65.0, 90.0
ONSET_S = 105.0
SEED = 3

METHODS = ("gaussian-sum", "mpf-pn")
FEW = {"gaussian-sum": 10, "mpf-pn": 200}
"""As many hypotheses and particles as the losses of these drives take: they are all that costs time."""
PLAYED_WITH = ["gaussian-sum"]
"""The filter that drives are played with is the last one (`conftest.method`)."""
Item = CanFrame | Sentence
Change = Callable[[list[Item], float], Iterable[Item]]
"""From the items of the drive and the stamp of its beginning to what is really received."""


@dataclass
class Outcome:
    """What the core made of a drive."""

    start_s: float
    steps: list[Step] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    pipeline: Pipeline | None = None

    @property
    def alarms(self) -> list[tuple[str, str | None, str]]:
        """(kind, wheel, raised or cleared), in order."""
        return [
            (str(event.kind), event.wheel, event.state) for step in self.steps for event in step.report.events
        ]

    @property
    def reasons(self) -> list[str]:
        """What was said of the alarms that were raised."""
        return [
            event.reason for step in self.steps for event in step.report.events if event.state == "raised"
        ]

    def when(self, kind: str, state: str = "raised") -> float:
        """Seconds from the start to the first alarm of a kind."""
        return next(
            step.tick.time_s - self.start_s
            for step in self.steps
            for event in step.report.events
            if (str(event.kind), event.state) == (kind, state)
        )

    @property
    def faults(self) -> Counter[tuple[str, str]]:
        """How many reports of (source, kind) the ticks bear."""
        return Counter((fault.source, fault.kind) for step in self.steps for fault in step.tick.faults)

    def blind(self, from_s: float = FROM_S, to_s: float = DURATION_S) -> float:
        """Seconds of ticks in a span of time (of the time line that only rises) without the rear pair."""
        return sum(
            step.tick.dt_s
            for step in self.steps
            if from_s <= step.tick.time_s - self.start_s < to_s
            and not np.all(np.isfinite(step.tick.rotation_rad[2:]))
        )


def with_method(config: Config) -> Config:
    """The configuration with the filter that drives are played with."""
    method = PLAYED_WITH[-1]
    settings = dataclasses.replace(config.filter, method=method, particles=FEW[method])
    return dataclasses.replace(config, filter=settings)


@functools.cache
def drive(kind: str = "counts16", duration_s: float = DURATION_S) -> tuple[Config, tuple[Item, ...]]:
    """Configuration and items of the drive on a bus of some kind; wheels and yaw rate are configured."""
    folder = Path(tempfile.mkdtemp(prefix="tpmsd-faults-"))
    fault = Fault("puncture", 2.0, "percent", "rl", ONSET_S, 8.0)
    write_drive(
        folder,
        simulate_drive(
            DriveSpec("motorway", duration_s, SEED, faults=(fault,), bus=BusSpec(kind=kind)),
        ),
    )
    config = load_config(folder)
    signals = {r: name for r, name in config.can.signals.items() if r.startswith("wheel_") or r == "yaw_rate"}
    config = dataclasses.replace(
        config,
        can=dataclasses.replace(config.can, signals=signals),
        filter=dataclasses.replace(config.filter, particles=FEW["gaussian-sum"]),
    )
    plans = compile_plans(config, load_database(config.can.dbc))
    wheels = {key for key, plan in plans.items() for group in plan.groups for s in group.signals if s.wheel}
    items: list[Item] = []
    for number, item in enumerate(FolderStream(folder)):
        if isinstance(item, Sentence) or item.arbitration_id in wheels:
            items.append(item)
        elif item.arbitration_id in plans and number % 4 == 0:
            items.append(item)  # the yaw rate, at a rate that costs little
    return config, tuple(items)


def played(
    change: Change = lambda items, start_s: items,
    kind: str = "counts16",
    config: Callable[[Config], Config] = lambda config: config,
    events: Callable[[float], list[SourceFault]] = lambda time_s: [],
) -> Outcome:
    """Play the drive as changed; `events`: the inputs' faults at a time since the start, every 0.1 s."""
    original, items = drive(kind)
    used = config(with_method(original))
    start_s = items[0].time_s
    outcome = Outcome(start_s)
    pipeline = outcome.pipeline = Pipeline(used, load_database(used.can.dbc))
    told_s = start_s
    for item in change(list(items), start_s):
        if isinstance(item, CanFrame):
            steps = pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            steps = pipeline.on_sentence(item.time_s, item.line)
        if abs(item.time_s - told_s) >= 0.1:
            told_s = item.time_s
            for fault in events(item.time_s - start_s):
                steps += pipeline.on_event(dataclasses.replace(fault, time_s=item.time_s))
        outcome.steps += steps
    outcome.steps += pipeline.finish()
    for name, count in pipeline.decoder.counts.items():
        outcome.counts[name.rpartition(".")[2]] += count
    outcome.counts.update({f"gnss.{kind}": n for kind, n in pipeline.assembler.counts.items() if n})
    return outcome


def during(time_s: float, start_s: float, from_s: float = FROM_S, to_s: float = TO_S) -> bool:
    """Whether a stamp lies in the part of the drive in which something happens."""
    return from_s <= time_s - start_s < to_s


FOUND = [("deflation", "rl", "raised"), ("radius_deviation", "rl", "raised")]
"""The alarms of the drive: the loss of 2 % is a deflation, and soon after a deviation of the radius too."""
