"""The daemon with an estimator that hangs: its loop turns, it answers, but makes no tick any more.

In: how many ticks it makes before (0: none at all), and a configuration.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tpmsd.car.config.load import load_config
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.journal import set_up_logging
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sources.can.decoder import load_database

parser = argparse.ArgumentParser()
parser.add_argument("ticks", type=int)
parser.add_argument("config", type=Path)
arguments = parser.parse_args()
made = 0


class Hanging(Pipeline):
    """A pipeline that stops to make ticks."""

    def _kept(self, steps: list[Step]) -> list[Step]:
        global made
        kept = steps[: max(arguments.ticks - made, 0)]
        made += len(kept)
        return kept

    def on_frame(self, *frame: Any) -> list[Step]:
        return self._kept(super().on_frame(*frame))

    def on_sentence(self, *sentence: Any) -> list[Step]:
        return self._kept(super().on_sentence(*sentence))

    def on_event(self, *event: Any) -> list[Step]:
        return self._kept(super().on_event(*event))

    def advance(self, *time: Any) -> list[Step]:
        return self._kept(super().advance(*time))


config = load_config(arguments.config)
database = load_database(config.can.dbc)
notifier = Notifier.from_environment()
Daemon(config, database, Clock(), notifier, log=set_up_logging(), make_pipeline=Hanging).run()
