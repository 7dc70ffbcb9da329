"""The campaigns by name.

A campaign's module has `options(parser)`, which adds its options, and `main(args)`, which runs it and gives
an exit code or its result as plain numbers. The modules are imported when they are asked for: most need
numpy, some need extras.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any


class UsageError(Exception):
    """Options that make no sense; the command line tells it like any other wrong usage."""


@dataclass(frozen=True)
class Campaign:
    """One thing that is measured."""

    name: str
    summary: str
    module: str
    page: str = ""
    """The page of docs/ that holds its tables."""

    @property
    def about(self) -> str:
        """The module's docstring."""
        return import_module(self.module).__doc__ or ""

    @property
    def options(self) -> Callable[[argparse.ArgumentParser], None]:
        """What adds its options to a parser."""
        return import_module(self.module).options  # type: ignore[no-any-return]

    @property
    def main(self) -> Callable[[argparse.Namespace], Any]:
        """What runs it; an exit code (int) or its result as plain numbers."""
        return import_module(self.module).main  # type: ignore[no-any-return]

    @property
    def report(self) -> Callable[[Path], str]:
        """What makes Markdown of the results in a folder; only where there is a page."""
        return import_module(self.module).report  # type: ignore[no-any-return]


def _campaign(layer: str, name: str, summary: str, module: str | None = None, page: str = "") -> Campaign:
    """A row; `layer` is the folder of the module, empty for one that measures the whole program."""
    folder = f"bench.campaigns.{layer}." if layer else "bench.campaigns."
    return Campaign(name, summary, folder + (module or name.replace("-", "_")), page)


CAMPAIGNS = {
    campaign.name: campaign
    for campaign in (
        _campaign("", "speed", "figures of the README: rates, memory, start-up", "speed_and_memory"),
        _campaign("", "command-times", "CPU time of discover, check, explain and web, as ratios to replay"),
        _campaign(
            "onboard", "gnss-accuracy", "radii with and without the receiver's own accuracy of its speed"
        ),
        _campaign("onboard", "decode", "CAN frames decoded per second, and how many of a log as arrays"),
        _campaign("onboard", "live", "the daemon in real time on a full bus"),
        _campaign("offline", "discover", "discovery of unknown cars among decoys, with a DBC and without"),
        _campaign(
            "offline", "calibrate", "calibration against the published method, and coverage of its intervals"
        ),
        _campaign(
            "offline",
            "diagnosis",
            "the diagnosis on drives whose truth is sealed",
            "diagnosis.run",
            "diagnose.md",
        ),
        _campaign(
            "offline", "goldens", "the program's answers to a fixed set of drives, compared with stored ones"
        ),
        _campaign(
            "offline", "origins", "the diagnosis on null drives and faults of every origin", page="origins.md"
        ),
        _campaign(
            "offline",
            "each-effect",
            "every effect of the catalogue by other formulas: named, intervals",
            page="effects.md",
        ),
        _campaign(
            "onboard",
            "alarms",
            "soft tyres and harmless drives: detection, false alarms per km",
            "alarms.run",
            "alarms.md",
        ),
        _campaign(
            "onboard",
            "realistic",
            "sixteen realistic cases, for any system on a CAN bus",
            "realistic.run",
        ),
        _campaign("onboard", "masking", "losses beside wheels of another size, on cars of four generators"),
        _campaign(
            "onboard",
            "filters",
            "alarms of both filters on the very same drives, and real losses",
            page="filters.md",
        ),
        _campaign(
            "onboard",
            "filter-drives",
            "both filters on the demonstration's drives and on recordings, and their cost",
            page="filters.md",
        ),
        _campaign(
            "onboard", "intervals", "NEES and coverage of both filters, cell by cell", page="intervals.md"
        ),
        _campaign(
            "onboard",
            "smoothers",
            "both filters beside a factor graph of GTSAM and the causal limit",
            page="estimators.md",
        ),
        _campaign("onboard", "first-start", "tyres that were soft before the first start"),
        _campaign(
            "onboard",
            "estimators",
            "filters side by side on the published comparison",
            "estimators.run",
            "estimators.md",
        ),
        _campaign(
            "onboard",
            "drift-levels",
            "coverage of the default under other levels of radius drift",
            "drift_levels",
        ),
        _campaign("car", "vehicle-state", "EKF, UKF, UPF and ARUPF on a multi-body car"),
        _campaign("car", "vehicle-state-paper", "the same on the paper's car and lane change, with series"),
        _campaign("car", "vehicle-state-drive", "the filters against the lateral speed of a recording"),
        _campaign("onboard", "slip-gate", "gates and weights of the tyre filter on hard drives"),
        _campaign("onboard", "puncture-delay", "delay to a puncture alarm under each gate"),
        _campaign("offline", "slip-regressors", "what slips by the tyre model would add to the diagnosis"),
        _campaign(
            "onboard", "resonance", "sampling rates at which the torsional resonance tells a soft tyre"
        ),
        _campaign(
            "offline", "independent-look", "plain least squares on recordings, apart from the diagnosis"
        ),
        _campaign("onboard", "slow-leak", "notices of slow leaks over years of simulated cars"),
        _campaign("offline", "fleet", "cost of a fleet: workers against a plain loop, the joint inference"),
        _campaign("offline", "fleet-scale", "a store of 100,000 drawn drives: joint, report, SQL"),
        _campaign("offline", "diagnosis-memory", "peak memory of the diagnosis over 1, 5 and 15 drives"),
        _campaign(
            "offline", "replicates", "seconds for bootstrap replicates of a drive, design fixed and again"
        ),
        _campaign("offline", "injected", "effects injected into real recordings"),
        _campaign("onboard", "online-radii", "radii on line against those of calibrate on recordings"),
        _campaign(
            "onboard", "recorded-losses", "losses of radius injected into real drives; drives in a row"
        ),
        _campaign("offline", "lost-counts", "false lost or added counts of late counts, and true ones found"),
        _campaign("offline", "concealed", "effects concealed in real recordings, diagnosed, unsealed"),
        _campaign(
            "offline", "proof", "effects of other worlds sealed, diagnosed, opened, scored", "proof.run"
        ),
        _campaign("offline", "dynamics", "baselines of vehicle dynamics: null drives, single effects, pairs"),
        _campaign(
            "offline",
            "dynamics-cars",
            "vehicle dynamics on cars of every size, other tyres, nameless physics",
        ),
        _campaign(
            "offline", "dynamics-proof", "a multi-body car and a real one: errors after each effect found"
        ),
    )
}
