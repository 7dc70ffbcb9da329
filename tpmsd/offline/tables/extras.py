"""The packages that tables need and the daemon does not: imported where used, with one line where missing.

In: nothing. Out: the module, or ConfigError that names the extra.
"""

from __future__ import annotations

import importlib
from typing import Any

from tpmsd.foundation.errors import ConfigError


def import_extra(module: str, extra: str, what: str) -> Any:
    """Import a module of an extra; ConfigError with the command that installs it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigError(not_installed_message(module, extra, what)) from None


def not_installed_message(module: str, extra: str, what: str) -> str:
    """Return the line that says which extra to install."""
    package = module.partition(".")[0]
    return f"{what} need {package}, which is not installed: pip install 'tpmsd[{extra}]'"


def import_pandas() -> Any:
    """Return pandas; ConfigError with the command that installs it."""
    return import_extra("pandas", "tables", "data frames")
