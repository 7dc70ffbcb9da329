"""`tpmsd record DIR`: CAN and receiver side by side, until Ctrl-C.

In: an interface, a receiver. Out: a drive folder's `can.log` and `gnss.nmea`; a live line on standard error.
"""

from __future__ import annotations

import argparse
import logging
import math
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Subparsers

if TYPE_CHECKING:
    from tpmsd.onboard.daemon.drive_recording import RecordingProgress

_EPILOG = """\
examples:
  tpmsd record drive/
  tpmsd record drive/ --channel can1 --source gpsd://localhost:2947

exit codes: 0 done, 1 it ended by itself (disk, limit), 2 wrong usage, 3 nothing was received
"""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "record",
        help="record CAN and receiver side by side, as a drive",
        description="Writes can.log and gnss.nmea with host stamps into DIR until Ctrl-C.\n"
        "No configuration is needed: 'tpmsd discover DIR' makes one of it.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("dir", metavar="DIR", type=Path, help="folder to record into")
    parser.add_argument("--interface", default="socketcan", metavar="I", help="python-can interface")
    parser.add_argument("--channel", default="can0", metavar="C", help="CAN channel")
    parser.add_argument("--fd", action="store_true", help="the bus carries CAN FD frames")
    parser.add_argument("--bitrate", type=int, metavar="B", help="for interfaces that set it themselves")
    parser.add_argument(
        "--source",
        default="serial:/dev/ttyACM0",
        metavar="S",
        help="serial:PATH | gpsd://HOST:PORT | tcp://HOST:PORT | udp://HOST:PORT | none",
    )
    parser.add_argument("--baud", type=int, default=115200, metavar="B", help="of a serial receiver")
    parser.add_argument("--max-mb", type=float, default=4096.0, metavar="MB", help="stop at this size")
    parser.add_argument("--duration", type=float, default=math.inf, metavar="S", help="stop after S seconds")


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd record`; return the exit code."""
    from tpmsd.car.config.gnss_source import parse_source
    from tpmsd.car.config.model import CanConfig, GnssConfig
    from tpmsd.car.config.problems import BadValueError
    from tpmsd.interfaces.cli.run import known_interface
    from tpmsd.onboard.daemon.bus_link import BusLink, open_can
    from tpmsd.onboard.daemon.clock import Clock
    from tpmsd.onboard.daemon.drive_recording import DriveRecording
    from tpmsd.onboard.daemon.receiver_link import ReceiverLink, configured_receiver, configured_stream

    if not args.max_mb > 0 or not args.duration > 0:
        raise ConfigError("--max-mb and --duration must be above 0")
    known_interface(args.interface)
    if not args.baud > 0:
        raise ConfigError(f"--baud {args.baud} must be above 0")
    log = logging.getLogger("tpmsd.record")
    clock = Clock()
    can = CanConfig({}, Path(), args.interface, args.channel, args.fd, args.bitrate)
    bus = BusLink(
        lambda: open_can(can, None, args.channel), f"CAN {args.channel}", log, args.interface == "socketcan"
    )
    receiver = None
    if args.source != "none":
        try:
            parse_source(args.source)
        except BadValueError as bad:
            raise ConfigError(
                f"--source {args.source}: {bad.what}; allowed: {bad.allowed}, or none"
            ) from None
        gnss = GnssConfig(source=args.source, baud=args.baud)
        receiver = ReceiverLink(configured_receiver(gnss), args.source, log, configured_stream(gnss))
    limit = int(min(args.max_mb, 1e7) * (1 << 20))
    recording = DriveRecording(args.dir, bus, receiver, clock.now, clock.monotonic, limit)
    stopped: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in before:
        signal.signal(number, lambda got, _: stopped.append(got))
    try:
        seen = recording.run(
            lambda: bool(stopped), lambda now: _show_progress(now, bus.reason), args.duration
        )
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    print(
        f"{args.dir}: {seen.frames} frames of {len(seen.identifiers)} identifiers, "
        f"{seen.sentences} sentences, {seen.bytes / 1e6:.1f} MB"
    )
    if seen.why:
        print(f"tpmsd: recording ended: {seen.why}", file=sys.stderr)
        return 1
    if not seen.frames or (receiver is not None and not seen.sentences):
        silent = f"CAN {args.channel}" if not seen.frames else args.source
        print(f"tpmsd: nothing came from {silent}", file=sys.stderr)
        return 3
    return 0


def _show_progress(seen: RecordingProgress, down: str) -> None:
    if not sys.stderr.isatty():
        return
    bus = down if down else f"{seen.frames_per_s:.0f} frames/s, {len(seen.identifiers)} ids"
    speed = "no speed" if math.isnan(seen.speed_mps) else f"{3.6 * seen.speed_mps:.0f} km/h"
    fix = f"fix {seen.quality}, {speed}" if seen.sentences else "no receiver"
    sys.stderr.write(f"\r{bus}; {fix}; {seen.bytes / 1e6:.1f} MB".ljust(78)[:100])
    sys.stderr.flush()
