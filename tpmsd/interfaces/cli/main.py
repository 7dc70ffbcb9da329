"""The command `tpmsd`: finds the sub-command, runs it and turns every error into one line and an exit code.

In: the command line. Out: the exit code. Each command is a module of its own with `add_parser(subparsers)`
and `run(args) -> int`; only the one that is asked for is imported, since numpy and cantools take their time.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib
import importlib.util
import io
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from tpmsd.car.config.suggest import nearest
from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.foundation.kernels import kernel
from tpmsd.foundation.startup import freeze_imported_objects, import_on_demand, leave_out_mf4, no_collection
from tpmsd.foundation.version import __version__
from tpmsd.interfaces.cli.effects_path import add_effects_option, use_own_effects
from tpmsd.interfaces.cli.output import Subparsers
from tpmsd.interfaces.cli.output_files import forget_stdout
from tpmsd.interfaces.cli.parser import EXIT_CODES, Parser

Commands = tuple[tuple[str, str, str], ...]

COMMANDS: Commands = (
    ("run", "tpmsd.interfaces.cli.run", "watch the tyres of this car: the daemon"),
    ("status", "tpmsd.interfaces.cli.status", "ask the running daemon how the tyres are"),
    ("reset", "tpmsd.interfaces.cli.reset", "tell the running daemon to learn the tyres again"),
    ("replay", "tpmsd.interfaces.cli.replay", "run a recorded drive through the same core, at full speed"),
    ("explain", "tpmsd.interfaces.cli.explain", "why an alarm is active, or why none is"),
    (
        "bridge",
        "tpmsd.interfaces.cli.bridge",
        "state and alarms to MQTT, Prometheus, D-Bus, VSS; speeds from VSS",
    ),
    (
        "simulate",
        "tpmsd.interfaces.cli.simulate",
        "make a drive, with a puncture if wanted: to a folder or live",
    ),
    (
        "check",
        "tpmsd.interfaces.cli.check",
        "check a configuration and say what would be monitored with what",
    ),
    ("discover", "tpmsd.interfaces.cli.discover", "find the wheels of an unknown car from a recorded drive"),
    ("web", "tpmsd.interfaces.cli.web", "a page for the running daemon or a recorded drive"),
    ("init", "tpmsd.interfaces.cli.init", "write a configuration to start from for a known car"),
    ("record", "tpmsd.interfaces.cli.record", "record CAN and receiver side by side, as a drive"),
    ("calibrate", "tpmsd.interfaces.cli.calibrate", "learn the radii of a car from a recorded drive"),
    (
        "diagnose",
        "tpmsd.interfaces.cli.diagnose",
        "say which physics a recorded drive holds that the model lacks",
    ),
    ("unseal", "tpmsd.interfaces.cli.unseal", "open the truth of concealed effects, and score a report"),
    (
        "effects",
        "tpmsd.interfaces.cli.effects",
        "list the effects that are known, and what a drive tells of them",
    ),
    ("plan", "tpmsd.interfaces.cli.plan", "propose what to drive so that effects can be distinguished"),
    (
        "fleet",
        "tpmsd.interfaces.cli.fleet",
        "many drives of many cars: in parallel, as tables, judged together",
    ),
    ("completion", "tpmsd.interfaces.cli.completion", "a completion script for bash, zsh or fish"),
    (
        "import",
        "tpmsd.interfaces.cli.import_table",
        "make a drive of a table of your own simulator or logger",
    ),
)
"""Name, module and one-line help of every command; one whose module is not there is left out."""

_CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells have it

_EPILOG = f"""\
examples:
  tpmsd check vehicle.toml         is the configuration right, and what will be monitored?
  tpmsd replay drives/monday       what would the daemon have said on this drive?

{EXIT_CODES}"""


def main(argv: Sequence[str] | None = None, commands: Commands = COMMANDS) -> int:
    """Run one of `commands`; `argv` defaults to the process's own arguments."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    leave_out_mf4()
    import_on_demand()
    try:
        if isinstance(sys.stdout, io.TextIOWrapper):
            # A path or a unit that the terminal cannot show must not end the command.
            sys.stdout.reconfigure(errors="backslashreplace")
        code = _run_command(arguments, commands)
        if sys.stdout is not None:
            sys.stdout.flush()
    except TpmsdError as error:
        for line in str(error).splitlines():
            _print_error(line)
        return error.exit_code
    except KeyboardInterrupt:
        _print_error("interrupted")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        forget_stdout()
        return 0  # who closed the pipe (`| head`) has seen enough
    except Exception as error:
        if os.environ.get("TPMSD_DEBUG"):
            traceback.print_exc()
        if isinstance(error, OSError):
            forget_stdout()  # it may be the disk under standard output that is full
            if error.filename is not None and error.strerror:
                _print_error(f"{_shortened_name(str(error.filename))}: {error.strerror}")
                return 1
            if error.errno in _CANNOT_WRITE:  # files are written by functions that name them
                _print_error(f"standard output: {error.strerror}")
                return 1
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        _print_error(f"internal error: {reason} (set TPMSD_DEBUG=1 for the traceback)")
        return 1
    return code


def _shortened_name(name: str, longest: int = 100) -> str:
    """Return a file's name on one line, cut after `longest` characters."""
    name = " ".join(name.split())
    return name if len(name) <= longest else f"{name[:longest]}..."


def _refuse_control_characters(args: argparse.Namespace) -> None:
    """Raise ConfigError on an argument with a control character, as messages and logs are one line each. The
    arguments that a command lists as `free_text` may hold them."""
    for name, value in vars(args).items():
        for one in value if isinstance(value, list) else [value]:
            held = (
                str(one) if isinstance(one, str | Path) and name not in getattr(args, "free_text", ()) else ""
            )
            if any(ord(letter) < 32 or ord(letter) == 127 for letter in held):
                raise ConfigError(f"{held!r}: names and values cannot hold line ends or control characters")


def _run_command(arguments: list[str], commands: Commands) -> int:
    """Import the chosen command's module alone, parse the arguments, and return its exit code."""
    parser, subparsers = _top_parser()
    wanted = next((argument for argument in arguments if not argument.startswith("-")), None)
    runner, chosen = None, parser
    for name, module_name, summary in commands:
        if importlib.util.find_spec(module_name) is None:
            continue
        if name == wanted:
            with no_collection():  # nearly all that an import makes stays
                first = module_name not in sys.modules
                module = importlib.import_module(module_name)
                if first:
                    freeze_imported_objects()
            module.add_parser(subparsers)
            add_effects_option(name, subparsers)
            runner, chosen = module.run, subparsers.choices[name]
        else:
            subparsers.add_parser(name, help=summary, add_help=False)
    names = list(subparsers.choices)
    if wanted is not None and wanted not in names:
        near = nearest(wanted, names)
        parser.error(f"no such command: {wanted}" + (f"; did you mean {near}?" if near else ""))
    try:
        args, unknown = parser.parse_known_args(arguments)
    except SystemExit as leaving:  # argparse has said what it had to say
        return leaving.code if isinstance(leaving.code, int) else 2
    if unknown:
        chosen.refuse_unknown(unknown)
    if runner is None:
        parser.print_help(sys.stderr)
        return 2
    _refuse_control_characters(args)
    use_own_effects(args)
    return int(runner(args))


def _top_parser() -> tuple[Parser, Subparsers]:
    parser = Parser(
        prog="tpmsd",
        description="Finds soft tyres without pressure sensors: from the ABS wheel signals on a CAN bus and\n"
        "a GNSS receiver. 'tpmsd COMMAND --help' explains each command.",
        epilog=_EPILOG,
    )
    parser.add_argument("--version", action="version", version=f"tpmsd {__version__} (kernel: {kernel()})")
    return parser, parser.add_subparsers(title="commands", metavar="COMMAND", dest="command")


def full_parser(commands: Commands = COMMANDS) -> Parser:
    """Return the parser with the options of all commands: for manual pages, completions and the reference."""
    parser, subparsers = _top_parser()
    for name, module_name, _ in commands:
        if importlib.util.find_spec(module_name) is not None:
            importlib.import_module(module_name).add_parser(subparsers)
            add_effects_option(name, subparsers)
    return parser


def _print_error(line: str) -> None:
    from tpmsd.car.config.problems import escaped_lines  # of no use where all goes well

    # Where nobody listens on standard error, the exit code still tells.
    with contextlib.suppress(OSError):
        print(f"tpmsd: {escaped_lines(line)}", file=sys.stderr)
