"""tpmsd: finds soft tyres without pressure sensors.

    import tpmsd
    drive = tpmsd.load("drives/monday")       # or tpmsd.Drive.from_tables(wheels=..., gnss=..., vehicle=...)
    tpmsd.replay(drive).alarms                # what the daemon would have said
    tpmsd.diagnose(drive).findings            # which physics the rolling model leaves out
    tpmsd.calibrate(drive).radii_m

Each name is imported on first use, so that `import tpmsd` itself takes milliseconds. The flow runs one way,
and so do the imports:

    sources -> timeline -> estimators -> monitor -> sinks

`pipeline` strings the pure rooms together; `api` is the Python face; `daemon` and `cli` do the I/O.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tpmsd.api.discover import Discovery, discover
    from tpmsd.api.drive import Drive, load
    from tpmsd.api.functions import calibrate, diagnose, replay, simulate
    from tpmsd.api.import_table import load_table
    from tpmsd.api.results import Calibration, Diagnosis, Replay
    from tpmsd.errors import ConfigError, InputError, TpmsdError
    from tpmsd.simulator.faults import Fault

__version__ = "0.1.0"

_HOME = {
    "Drive": "tpmsd.api.drive",
    "load": "tpmsd.api.drive",
    "load_table": "tpmsd.api.import_table",
    "replay": "tpmsd.api.functions",
    "diagnose": "tpmsd.api.functions",
    "calibrate": "tpmsd.api.functions",
    "simulate": "tpmsd.api.functions",
    "discover": "tpmsd.api.discover",
    "Discovery": "tpmsd.api.discover",
    "Replay": "tpmsd.api.results",
    "Diagnosis": "tpmsd.api.results",
    "Calibration": "tpmsd.api.results",
    "Fault": "tpmsd.simulator.faults",
    "ConfigError": "tpmsd.errors",
    "InputError": "tpmsd.errors",
    "TpmsdError": "tpmsd.errors",
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
    """What completion offers."""
    return sorted({*globals(), *__all__})
