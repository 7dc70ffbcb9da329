"""`tpmsd replay DRIVE`: runs a recorded drive through the daemon's own core, at full speed.

In: a drive folder. Out: a summary, JSON and a picture; progress on standard error.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from pathlib import Path

from tpmsd.cli.output import Progress, Subparsers, add_json_option, write_json
from tpmsd.config.load import load_config
from tpmsd.config.model import Config
from tpmsd.errors import ConfigError, InputError
from tpmsd.physics.model import ExtendedModel
from tpmsd.physics.model_file import load_model
from tpmsd.pipeline import Pipeline, Step
from tpmsd.report.replay_document import replay_document
from tpmsd.report.replay_recorder import ReplayRecorder
from tpmsd.report.replay_result import ReplayResult
from tpmsd.report.replay_summary import replay_summary
from tpmsd.sources.can_decoder import CanDecoder, load_database
from tpmsd.sources.can_frame import CanFrame
from tpmsd.sources.drive import Drive
from tpmsd.sources.plain_nmea import clock_offset

_DESCRIPTION = """\
Runs a recorded drive through the same core as the daemon, at full speed, and says what the daemon would
have said: radius of each wheel with its standard deviation, alarms, and how well the inputs served.

DRIVE is a folder with vehicle.toml, bus.dbc, can.log (or .log.gz .asc .blf .trc .mf4) and gnss.nmea.
"""
_EPILOG = """\
examples:
  tpmsd replay drives/monday
  tpmsd replay drives/monday --plot monday.png --json monday.json
  tpmsd replay drives/monday --config other.toml     the same drive with another configuration
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add `replay` to the command line."""
    parser = subparsers.add_parser(
        "replay",
        help="run a recorded drive through the daemon's core",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("drive", type=Path, metavar="DRIVE", help="drive folder")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="configuration instead of DRIVE/vehicle.toml"
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a picture (.png .svg .pdf)")
    parser.add_argument(
        "--model", type=Path, metavar="FILE", help="physics of a model.toml to be compensated"
    )
    parser.add_argument("--method", help="estimator instead of the configured one: mpf-rb or mpf-pn")
    parser.add_argument("--seed", type=int, help="seed of the estimator instead of the configured one")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Replay the drive."""
    if args.plot is not None:
        from tpmsd.report.replay_plot import check_plot_target

        check_plot_target(args.plot)  # before the work, not after it
    config = load_config(args.config if args.config is not None else _vehicle_of(args.drive))
    config = _overridden(config, args)
    model = None if args.model is None else load_model(args.model)
    result = replay(args.drive, config, model)
    if args.plot is not None:
        from tpmsd.report.replay_plot import plot_replay

        plot_replay(result, args.plot)
    if args.json is not None:
        write_json(replay_document(result), args.json)
    if args.json != "-":
        print(replay_summary(result))
    return 0


def _vehicle_of(drive: Path) -> Path:
    if not drive.is_dir():
        raise InputError(drive, "not a folder" if drive.exists() else "no such drive folder")
    return drive


def _overridden(config: Config, args: argparse.Namespace) -> Config:
    from dataclasses import replace as changed

    filter_config = config.filter
    if args.method is not None:
        filter_config = changed(filter_config, method=args.method)
    if args.seed is not None:
        if args.seed < 0:
            raise ConfigError(f"--seed {args.seed}: a seed is 0 or more")
        filter_config = changed(filter_config, seed=args.seed)
    return changed(config, filter=filter_config)


def replay(folder: Path, config: Config, model: ExtendedModel | None = None) -> ReplayResult:
    """Run a drive through the core; raises InputError if nothing usable is in it."""
    drive = Drive(folder)
    database = load_database(config.can.dbc)
    try:
        decoder, pipeline = CanDecoder(config, database), Pipeline(config, database, model)
    except ConfigError as error:
        raise ConfigError(f"{config.file or folder}: {error}") from None
    if not drive.host_times:
        _align_clocks(drive, config, decoder)
    recorder = ReplayRecorder(folder.resolve().name, config.vehicle, config.monitor)
    begun = time.perf_counter()
    start: float | None = None
    with Progress(drive.span_s() if sys.stderr.isatty() else 0.0, "replay") as progress:
        for number, item in enumerate(drive):
            start = item.time_s if start is None else start
            if isinstance(item, CanFrame):
                if item.is_error or item.is_remote:
                    continue
                steps = pipeline.on_frame(
                    item.time_s, item.arbitration_id, item.is_extended, item.data, item.is_fd
                )
            else:
                steps = pipeline.on_sentence(item.time_s, item.line)
            _record(recorder, steps)
            if number % 2000 == 0:
                progress.update(item.time_s - start)
    _record(recorder, pipeline.finish())
    _check_usable(drive, pipeline)
    for source, note in drive.first_bad.items():
        count = drive.counts[f"{source} bad lines"]
        lines = "1 bad line" if count == 1 else f"{count} bad lines"
        print(f"tpmsd: {lines} skipped, first {note}", file=sys.stderr)
    result = recorder.result(0.0)
    return dataclasses.replace(
        result, realtime_factor=result.duration_s / max(time.perf_counter() - begun, 1e-9)
    )


def _align_clocks(drive: Drive, config: Config, decoder: CanDecoder) -> None:
    """Put plain NMEA lines, whose UTC is their only clock, onto the host clock of the CAN log."""
    radius_m = config.vehicle.wheel_radius_m[2]
    found = clock_offset(Drive(drive.folder), decoder, radius_m)
    if found is not None and found.trusted:
        drive.gnss_offset_s = found.offset_s
        note = f"shifted by {found.offset_s:+.2f} s to fit the wheels (correlation {found.correlation:.3f})"
    else:
        note = "taken as the host clock, for the speeds do not tell its offset"
    print(f"tpmsd: {drive.nmea_log}: lines bear no host time; their UTC is {note}", file=sys.stderr)


def _record(recorder: ReplayRecorder, steps: list[Step]) -> None:
    for step in steps:
        recorder.add(step.tick, step.estimate, step.report)


def _check_usable(drive: Drive, pipeline: Pipeline) -> None:
    """A drive in which no wheel ever turned up is the wrong DBC or the wrong log, not a quiet drive."""
    counts = pipeline.decoder.counts
    if counts["frames"] == counts["ignored"]:
        raise InputError(
            drive.can_log,
            f"none of its {counts['frames']} frames has an identifier that the configured signals need "
            "(wrong DBC or log?)",
        )
