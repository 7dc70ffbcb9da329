"""`tpmsd run`: the daemon, in the foreground, as systemd and container runtimes want it.

In: a configuration. Out: alarms on the bus, the status socket, the journal; a recording if wanted.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.car.config.gnss_source import parse_source
from tpmsd.car.config.model import GnssConfig
from tpmsd.car.config.problems import BadValueError
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.startup import reserve_linear_algebra, without_openssl
from tpmsd.interfaces.cli.filter_options import add_filter_options, compensated_model, with_filter
from tpmsd.interfaces.cli.output import Subparsers

if TYPE_CHECKING:
    from tpmsd.car.config.model import Config

DEFAULT_CONFIG = Path("/etc/tpmsd/tpmsd.toml")

_DESCRIPTION = """\
Watches the tyres of this car: reads the wheels from the CAN bus and the fixes from the receiver, learns the
rolling radius of each wheel, and puts alarms on the bus, on the status socket and into the log.

It runs in the foreground until SIGTERM or Ctrl-C; then it saves what it has learned. A bus or receiver
that is missing or goes away is tried again until it is back. Under systemd it reports when it is ready and
how it is, and feeds the watchdog for as long as its estimate advances.
"""
_EPILOG = f"""\
examples:
  tpmsd run                                   with {DEFAULT_CONFIG}
  tpmsd run --config vehicle.toml --record /var/lib/tpmsd/drives/monday
                                              and later: tpmsd replay /var/lib/tpmsd/drives/monday
  tpmsd run --config vehicle.toml --channel vcan0 --device /run/user/1000/gnss --speed-up 10
                                              beside: tpmsd simulate --live vcan0 --speed-up 10 --pty ...
  tpmsd status --watch                        how it is, from another terminal

`tpmsd check FILE` says what is wrong with a configuration, or what would be monitored with it.

exit codes: 0 stopped in order; 2 wrong usage or configuration; 1 anything else
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        "run",
        help="watch the tyres of this car: the daemon",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help=f"configuration, or a drive folder with its vehicle.toml (default: {DEFAULT_CONFIG})",
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="log a line of state every few seconds")
    instead = parser.add_argument_group("instead of what the configuration says")
    instead.add_argument("--interface", metavar="I", help="python-can interface, such as socketcan")
    instead.add_argument("--channel", metavar="C", help="CAN channel, such as can0")
    instead.add_argument("--dbc", metavar="FILE", type=Path, help="DBC of the bus")
    instead.add_argument("--device", metavar="D", help="serial device of the receiver ('' for none)")
    add_filter_options(instead)
    instead.add_argument("--state", metavar="FILE", type=Path, help="what is kept over restarts")
    instead.add_argument("--socket", metavar="PATH", type=Path, help="Unix socket that tpmsd status asks")
    parser.add_argument(
        "--record",
        metavar="DIR",
        type=Path,
        help="also write what is received as a drive folder for tpmsd replay (if DIR holds one: DIR-2, ...)",
    )
    test = parser.add_argument_group("for tests and demonstrations")
    test.add_argument(
        "--speed-up", metavar="X", type=float, default=1.0, help="let the clock run X times faster"
    )
    test.add_argument("--duration", metavar="S", type=float, help="stop after S seconds of that clock")


def run(args: argparse.Namespace) -> int:
    """Run the daemon to its end."""
    # Here, since --help needs neither numpy nor cantools.
    with without_openssl():
        from tpmsd.onboard.daemon.clock import Clock
        from tpmsd.onboard.daemon.journal import set_up_logging
        from tpmsd.onboard.daemon.loop import Daemon
        from tpmsd.onboard.daemon.recorder import DriveRecorder
        from tpmsd.onboard.daemon.state_lock import state_lock
        from tpmsd.onboard.pipeline import Pipeline
        from tpmsd.onboard.sinks.sd_notify import Notifier
        from tpmsd.onboard.sources.can.databases import load_databases

    duration_s = math.inf if args.duration is None else float(args.duration)
    if not duration_s > 0.0:
        raise ConfigError(f"--duration {args.duration:g} is not a time to run")
    clock = Clock(args.speed_up)
    config, warnings = configuration(args)
    reserve_linear_algebra()
    log = set_up_logging(args.verbose)
    for warning in warnings:
        log.warning("%s", warning)
    recorder = None if args.record is None else DriveRecorder(args.record, config)
    model = compensated_model(config, args, partial(log.warning, "%s"))
    with state_lock(config.state.file):
        Daemon(
            config,
            load_databases(config),
            clock,
            Notifier.from_environment(),
            recorder=recorder,
            log=log,
            make_pipeline=partial(Pipeline, model=model),
        ).run(duration_s)
    return 0


def configuration(args: argparse.Namespace) -> tuple[Config, list[str]]:
    """Return the configuration with the command line's changes, and warnings; raises ConfigError."""
    from tpmsd.car.config.check import check
    from tpmsd.car.config.problems import ConfigProblems

    if args.config is None and not DEFAULT_CONFIG.exists():
        raise ConfigError(f"{DEFAULT_CONFIG}: no such file (--config FILE names another configuration)")
    source = DEFAULT_CONFIG if args.config is None else args.config
    result = check(source, args.dbc)
    if result.plan is None:
        raise ConfigProblems(result.problems)
    config = result.plan.config
    can, gnss = config.can, config.gnss
    if args.interface is not None:
        can = dataclasses.replace(can, interface=known_interface(args.interface))
    if args.channel is not None:
        can = dataclasses.replace(can, channel=_nonempty("--channel", args.channel))
    if args.device is not None:
        gnss = _with_receiver(gnss, args.device.strip())
    state, status = config.state, config.status
    warnings = [warning.text for warning in result.warnings]
    if args.state is not None:
        state = dataclasses.replace(state, file=args.state if args.state != Path() else None)
    elif source.is_dir() and state.file is not None and not _is_inside(state.file, source):
        # What is learned with a recording's configuration must not replace what the service learned.
        warnings.append(f"{source}: a drive folder: {state.file} is left alone (--state FILE keeps a state)")
        state = dataclasses.replace(state, file=None)
    if args.socket is not None:
        status = dataclasses.replace(status, socket=args.socket)
    if state.file is not None and state.file.is_dir():
        raise ConfigError(f"{state.file}: a folder; the state is kept in a file")
    config = dataclasses.replace(config, can=can, gnss=gnss, state=state, status=status)
    return with_filter(config, args), warnings


def _with_receiver(gnss: GnssConfig, device: str) -> GnssConfig:
    """Return `gnss` with the receiver of --device: a serial line, or an address as in [gnss] source."""
    if "://" not in device:
        return dataclasses.replace(gnss, device=device or None, source=None)
    try:
        parse_source(device)
    except BadValueError as bad:
        raise ConfigError(f"--device: {bad}") from None
    return dataclasses.replace(gnss, device=None, source=device)


def _is_inside(file: Path, folder: Path) -> bool:
    return file.resolve().is_relative_to(folder.resolve())


def known_interface(name: str) -> str:
    """Return the interface of `--interface`; ConfigError if python-can has none of that name."""
    import can

    from tpmsd.car.config.suggest import nearest

    if name in can.VALID_INTERFACES:
        return name
    near = nearest(name, can.VALID_INTERFACES)
    hint = f"did you mean {near}?" if near else f"there are {' '.join(sorted(can.VALID_INTERFACES))}"
    raise ConfigError(f"--interface {name}: no such python-can interface; {hint}")


def _nonempty(option: str, value: str) -> str:
    if not value.strip():
        raise ConfigError(f"{option} is empty")
    return value.strip()
