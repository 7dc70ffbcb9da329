"""tpmsd: finds soft tyres without pressure sensors.

    import tpmsd
    drive = tpmsd.load("drives/monday")       # or tpmsd.Drive.from_tables(wheels=..., gnss=..., vehicle=...)
    tpmsd.replay(drive).alarms                # what the daemon would have said
    tpmsd.diagnose(drive).findings            # which physics the rolling model leaves out
    tpmsd.calibrate(drive).radii_m

Each name is imported on first use, so that `import tpmsd` itself takes milliseconds. The package has five
layers, each with a docstring of its own; a layer imports those after it alone:

    interfaces    what people and programs touch
    offline       after the drive, on whole drives
    onboard       in the car, tick by tick
    car           what is known of a car
    foundation    small things without a subject
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.version import __version__

if TYPE_CHECKING:
    from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
    from tpmsd.interfaces.api.discover import Discovery, discover
    from tpmsd.interfaces.api.functions import calibrate, diagnose, replay, simulate
    from tpmsd.interfaces.api.import_table import load_table
    from tpmsd.interfaces.api.results import Calibration, Diagnosis, Replay
    from tpmsd.offline.drives.drive import Drive, load
    from tpmsd.offline.simulator.faults import Fault

_HOME = {
    "Drive": "tpmsd.offline.drives.drive",
    "load": "tpmsd.offline.drives.drive",
    "load_table": "tpmsd.interfaces.api.import_table",
    "replay": "tpmsd.interfaces.api.functions",
    "diagnose": "tpmsd.interfaces.api.functions",
    "calibrate": "tpmsd.interfaces.api.functions",
    "simulate": "tpmsd.interfaces.api.functions",
    "discover": "tpmsd.interfaces.api.discover",
    "Discovery": "tpmsd.interfaces.api.discover",
    "Replay": "tpmsd.interfaces.api.results",
    "Diagnosis": "tpmsd.interfaces.api.results",
    "Calibration": "tpmsd.interfaces.api.results",
    "Fault": "tpmsd.offline.simulator.faults",
    "ConfigError": "tpmsd.foundation.errors",
    "InputError": "tpmsd.foundation.errors",
    "TpmsdError": "tpmsd.foundation.errors",
}
"""Public name -> the module that has it."""

__all__ = [
    "Calibration",
    "ConfigError",
    "Diagnosis",
    "Discovery",
    "Drive",
    "Fault",
    "InputError",
    "Replay",
    "TpmsdError",
    "__version__",
    "calibrate",
    "diagnose",
    "discover",
    "load",
    "load_table",
    "replay",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'tpmsd' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return what completion offers."""
    return sorted({*globals(), *__all__})
