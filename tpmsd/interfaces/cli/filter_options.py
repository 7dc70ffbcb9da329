"""The options that replace the filter of a configuration: `--method`, `--seed`, `--model`.

In: a parser; what it read; a configuration. Out: the configuration with the filter that was asked for, and
the physics beyond rolling that is taken out of the ticks.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.car.config.model import FILTER_METHODS, Config
from tpmsd.foundation.errors import ConfigError

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel


def add_filter_options(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Declare `--model`, `--method` and `--seed`."""
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="physics of a model.toml to be compensated"
    )
    known = ", ".join(FILTER_METHODS)
    parser.add_argument("--method", help=f"estimator instead of the configured one: {known}")
    parser.add_argument("--seed", type=int, help="seed of the estimator instead of the configured one")


def refuse_without_drive(args: argparse.Namespace) -> None:
    """Raise ConfigError where the running daemon is asked, whose filter is that of its configuration."""
    for option in ("model", "method", "seed"):
        if getattr(args, option) is not None:
            raise ConfigError(f"--{option} goes with a DRIVE: the daemon has the filter of its configuration")


def with_filter(config: Config, args: argparse.Namespace) -> Config:
    """Return the configuration with the method and the seed that were asked for.

    Raises:
        ConfigError: there is no such method, or the seed is negative.
    """
    from tpmsd.onboard.estimators.table import ALIASES, TABLE, row_of  # numpy, which --help does without

    settings = config.filter
    if args.method is not None:
        if row_of(args.method) is None:
            raise ConfigError(f"--method: unknown {args.method!r}; known: {', '.join([*TABLE, *ALIASES])}")
        settings = dataclasses.replace(settings, method=args.method)
    if args.seed is not None:
        if args.seed < 0:
            raise ConfigError(f"--seed {args.seed}: a seed is 0 or more")
        settings = dataclasses.replace(settings, seed=args.seed)
    return dataclasses.replace(config, filter=settings)


def compensated_model(
    config: Config, args: argparse.Namespace, note: Callable[[str], None]
) -> ExtendedModel | None:
    """Return the model of `--model`, else of `[filter] model`, else None; `note` gets a line for each effect
    that cannot be compensated.

    Raises:
        ConfigError: the file is no model.
    """
    file = args.model or config.filter.model
    if file is None:
        return None
    from tpmsd.car.physics.model_file import load_model  # likewise
    from tpmsd.onboard.timeline.compensation import uncompensated_effects

    model = load_model(file)
    for line in uncompensated_effects(config, model):
        note(f"{file}: {line}")
    return model
