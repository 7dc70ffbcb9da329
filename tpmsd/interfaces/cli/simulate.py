"""`tpmsd simulate`: make a drive, with a fault or an effect if wanted: to a folder, or live.

In: the command line. Out: a drive folder (docs/reference/formats.md) with its truth.json, or live traffic.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.car.physics.baselines.names import DYNAMICS_BASELINES
from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.interfaces.cli.output import Progress, Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs
from tpmsd.interfaces.cli.simulate_injection import add_onto_options, model_of_options, run_onto

if TYPE_CHECKING:
    from tpmsd.car.config.model import VehicleConfig
    from tpmsd.car.physics.motion import Motion
    from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive
    from tpmsd.offline.simulator.faults import Fault

SCHEMA = "tpmsd.simulation/2"
_EPILOG = """\
examples:
  tpmsd simulate drives/healthy
  tpmsd simulate drives/nail --puncture rl --loss-percent 2 --over 30 --at 300
  tpmsd simulate drives/slow --leak fr --pressure-percent 25 --over 900 --duration 1800
  tpmsd simulate drives/winter --diffusion --pressure-percent 20 --route motorway
  tpmsd simulate drives/grown --effect centrifugal_growth:coefficient=1e-6 \\
                              --effect gnss_latency:latency_s=0.15
  tpmsd simulate drives/again --model model.toml --seed 7
  tpmsd simulate drives/late --onto drives/monday --effect gnss_latency:latency_s=0.15
  tpmsd simulate drives/riddle --onto drives/monday --conceal 2    the truth is sealed: tpmsd unseal
  tpmsd simulate --live vcan0 --puncture rl --at 120        and, elsewhere: tpmsd run
  tpmsd simulate live --live vcan0 --pty /run/user/1000/gnss    writes live/vehicle.toml for tpmsd run

routes: city rural motorway mixed oval test-track hills

effects: every effect of the catalogue, as name:parameter=value,parameter=value
"""

_ROUTES = ("city", "rural", "motorway", "mixed", "oval", "test-track", "hills")
_BUSES = ("counts16", "counts8", "split", "speeds")
_WHEELS = ("fl", "fr", "rl", "rr")


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "simulate",
        help="make a drive, with a puncture if wanted: to a folder or live",
        description="Simulate a car on a road, its CAN bus and its receiver. The drive goes to a folder\n"
        "that tpmsd replay reads, or live onto a CAN interface and a pseudo terminal for tpmsd run.",
        epilog=_EPILOG,
    )
    parser.add_argument("out", metavar="OUT", nargs="?", type=Path, help="folder to write the drive to")
    parser.add_argument(
        "--force", action="store_true", help="replace a drive in OUT that tpmsd simulate wrote before"
    )
    drive = parser.add_argument_group("the drive")
    drive.add_argument("--duration", metavar="SECONDS", type=float, default=600.0, help="default: 600")
    drive.add_argument("--route", choices=_ROUTES, default="mixed", help="default: mixed")
    drive.add_argument(
        "--route-file", metavar="FILE", type=Path, help="manoeuvres instead, as tpmsd plan writes them"
    )
    drive.add_argument("--flat", action="store_true", help="no slopes")
    drive.add_argument(
        "--seed", metavar="N", type=int, help="same seed, same drive (default: 1; of --conceal: a random one)"
    )

    car = parser.add_argument_group("the car and its bus")
    car.add_argument(
        "--vehicle", metavar="FILE", type=Path, help="take the car of this vehicle.toml or drive folder"
    )
    car.add_argument(
        "--radius-offset-mm",
        metavar="FL,FR,RL,RR",
        help="true minus nominal radius (default: drawn, standard deviation 1 mm)",
    )
    car.add_argument("--bus", choices=_BUSES, default="counts16", help="what the bus carries")
    car.add_argument("--wheels", type=int, choices=(2, 4), default=4, help="2: the rear pair alone")
    car.add_argument("--lost-percent", metavar="P", type=float, default=0.0, help="frames that are lost")
    car.add_argument("--repeated-percent", metavar="P", type=float, default=0.0, help="frames sent twice")
    car.add_argument(
        "--reset", metavar="SECONDS", type=float, action="append", default=[], help="counters restart here"
    )

    gnss = parser.add_argument_group("the receiver")
    gnss.add_argument("--receiver-hz", metavar="HZ", type=float, default=5.0, help="1 to 10 (default: 5)")
    gnss.add_argument("--position-std", metavar="M", type=float, default=1.2, help="slow error per axis")
    gnss.add_argument("--latency", metavar="SECONDS", type=float, default=0.06, help="known age of a fix")
    gnss.add_argument(
        "--outage", metavar="FROM:TO", action="append", default=[], help="no fix between these seconds"
    )
    gnss.add_argument("--outages-per-hour", metavar="N", type=float, default=0.0, help="random ones")
    gnss.add_argument("--jumps-per-hour", metavar="N", type=float, default=0.0, help="multipath")
    gnss.add_argument(
        "--sentences", metavar="LIST", default="RMC,GGA", help="of RMC GGA VTG GST ZDA (default: RMC,GGA)"
    )
    gnss.add_argument(
        "--host-offset", metavar="SECONDS", type=float, default=0.0, help="host clock minus UTC"
    )
    gnss.add_argument("--host-drift-ppm", metavar="PPM", type=float, default=0.0)

    fault = parser.add_argument_group("a fault")
    kind = fault.add_mutually_exclusive_group()
    kind.add_argument("--puncture", metavar="WHEEL", choices=_WHEELS, help="pressure lost within seconds")
    kind.add_argument("--leak", metavar="WHEEL", choices=_WHEELS, help="pressure lost within minutes")
    kind.add_argument("--step", metavar="WHEEL", choices=_WHEELS, help="radius changes at once")
    kind.add_argument("--diffusion", action="store_true", help="all four tyres lose pressure slowly")
    size = fault.add_mutually_exclusive_group()
    size.add_argument("--loss-percent", metavar="P", type=float, help="of the radius (default: 2)")
    size.add_argument("--loss-mm", metavar="MM", type=float, help="of the radius")
    size.add_argument("--pressure-percent", metavar="P", type=float, help="of the pressure")
    fault.add_argument(
        "--over", metavar="SECONDS", type=float, help="default: 30 puncture, 600 leak, 1800 diffusion"
    )
    fault.add_argument("--at", metavar="SECONDS", type=float, help="onset (default: half of the duration)")

    physics = parser.add_argument_group("physics beyond rolling")
    physics.add_argument(
        "--effect", metavar="NAME:PARAM=VALUE,...", action="append", default=[], help="may be repeated"
    )
    physics.add_argument("--model", metavar="FILE", type=Path, help="the effects of a model.toml")

    dynamics = parser.add_argument_group("vehicle dynamics")
    dynamics.add_argument(
        "--baseline",
        choices=DYNAMICS_BASELINES,
        help="write what this baseline, with the effects of --model, predicts for the inputs of a recording",
    )
    dynamics.add_argument("--inputs", metavar="DRIVE", type=Path, help="the recording, with signals.csv")

    live = parser.add_argument_group("live")
    live.add_argument("--live", metavar="CHANNEL", help="play onto this CAN channel and a pseudo terminal")
    live.add_argument(
        "--interface", metavar="I", default="socketcan", help="python-can interface (default: socketcan)"
    )
    live.add_argument("--speed-up", metavar="X", type=float, default=1.0, help="default: 1")
    live.add_argument("--pty", metavar="PATH", type=Path, help="make this a link to the pseudo terminal")
    add_json_option(parser)
    add_onto_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run `tpmsd simulate`; return the exit code."""
    if args.onto is not None or args.conceal is not None:
        return run_onto(args)
    if args.baseline is not None or args.inputs is not None:
        from tpmsd.interfaces.cli.simulate_dynamics import run_inputs

        return run_inputs(args)
    # Here, since --help does not need numpy.
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.simulator.drive import simulate_drive
    from tpmsd.offline.simulator.drive_writer import check_drive_folder

    if args.out is None and args.live is None:
        raise ConfigError("tpmsd simulate: give a folder OUT, or --live CHANNEL, or both")
    if args.live is None and (args.pty is not None or args.speed_up != 1.0):
        raise ConfigError("--pty and --speed-up go with --live CHANNEL")
    outputs = Outputs(("--json", args.json))
    spec = spec_of(args)
    if args.out is not None:
        check_drive_folder(args.out, args.force)
    motion = _route_motion(args, spec)
    if motion is not None:
        spec = dataclasses.replace(
            spec, route=args.route_file.name, duration_s=float(motion.time_s[-1]), flat=False
        )
    if args.live is None:
        drive = simulate_drive(spec, motion)
        document = report(drive)
        _write_folder(args.out, drive, None)
    else:
        document = _play_live(args, spec, motion)
    if args.out is not None:
        document["folder"] = str(args.out)
    outputs.say(summary(document))
    outputs.write({"--json": lambda: json_text({**provenance(SCHEMA, (), args.vehicle), **document})})
    return 0


def _route_motion(args: argparse.Namespace, spec: DriveSpec) -> Motion | None:
    """Return the motion along the route file of the command line; None where the route is drawn at random."""
    if args.route_file is None:
        return None
    from tpmsd.offline.simulator.manoeuvres import load_route, motion_of

    return motion_of(load_route(args.route_file), spec.vehicle.wheelbase_m)


def spec_of(args: argparse.Namespace) -> DriveSpec:
    """Return the drive that the command line asks for; ConfigError with one line on what makes no sense."""
    from tpmsd.offline.simulator.bus import BusSpec
    from tpmsd.offline.simulator.clock import DEFAULT_START_UTC_S, Clocks
    from tpmsd.offline.simulator.drive import DriveSpec
    from tpmsd.offline.simulator.receiver import ReceiverSpec

    vehicle, forward, left = _read_vehicle(args.vehicle)
    return DriveSpec(
        route=args.route,
        duration_s=args.duration,
        seed=1 if args.seed is None else args.seed,
        vehicle=vehicle,
        antenna_forward_m=forward,
        antenna_left_m=left,
        radius_offset_m=_parse_four_mm(args.radius_offset_mm),
        flat=args.flat,
        faults=_parse_faults(args),
        model=model_of_options(args),
        receiver=ReceiverSpec(
            rate_hz=args.receiver_hz,
            position_std_m=_nonnegative("--position-std", args.position_std),
            latency_s=_nonnegative("--latency", args.latency),
            outages=tuple(_parse_span(text) for text in args.outage),
            outages_per_hour=_nonnegative("--outages-per-hour", args.outages_per_hour),
            jumps_per_hour=_nonnegative("--jumps-per-hour", args.jumps_per_hour),
            sentences=tuple(word.strip().upper() for word in args.sentences.split(",") if word.strip()),
        ),
        bus=BusSpec(
            kind=args.bus,
            wheels=args.wheels,
            lost_fraction=_fraction_of_percent("--lost-percent", args.lost_percent),
            repeated_fraction=_fraction_of_percent("--repeated-percent", args.repeated_percent),
            resets_s=tuple(args.reset),
        ),
        clocks=Clocks(
            # A live receiver tells the time of day as it is.
            start_utc_s=DEFAULT_START_UTC_S if args.live is None else float(round(time.time())),
            host_offset_s=args.host_offset,
            host_drift_ppm=args.host_drift_ppm,
        ),
    )


def report(drive: SimulatedDrive) -> dict[str, Any]:
    """Return the document of the simulated drive, for JSON and for people."""
    truth = drive.truth()
    kept = ("seed", "route", "duration_s", "distance_m", "start_host_s", "nominal_radius_m", "effects")
    return {
        **{key: truth[key] for key in kept},
        "faults": truth["faults"],
        "final_deviation_mm": {wheel: 1000.0 * values[-1] for wheel, values in truth["deviation_m"].items()},
        "frames": len(drive.frames),
        "sentences": len(drive.nmea),
    }


def summary(document: dict[str, Any]) -> str:
    """Return the report in lines for people."""
    km = document["distance_m"] / 1000.0
    lines = [
        f"{document['route']} drive of {document['duration_s']:.0f} s and {km:.1f} km: "
        f"{document['frames']} frames, {document['sentences']} sentences"
    ]
    for effect in document["effects"]:
        values = ", ".join(f"{key} = {_value_text(value)}" for key, value in effect["parameters"].items())
        lines.append(f"  {effect['name']}" + (f": {values}" if values else ""))
    offsets = "  ".join(f"{wheel} {value:+.2f}" for wheel, value in document["final_deviation_mm"].items())
    lines.append(f"  radius minus nominal at the end, mm: {offsets}")
    if "folder" in document:
        lines.append(f"written to {document['folder']} (the truth is in truth.json)")
    return "\n".join(lines)


def _value_text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _write_folder(out: Path, drive: SimulatedDrive, vehicle_toml: str | None) -> None:
    from tpmsd.offline.simulator.drive_writer import write_drive

    with Progress(drive.spec.duration_s, "writing") as progress:
        write_drive(out, drive, progress.update, vehicle_toml)


def _play_live(args: argparse.Namespace, spec: DriveSpec, motion: Motion | None) -> dict[str, Any]:
    """Write the configuration, simulate and play live; return the document."""
    import can

    from tpmsd.offline.simulator.drive import live_configuration, live_dbc, simulate_drive
    from tpmsd.offline.simulator.drive_writer import write_start
    from tpmsd.offline.simulator.live import LivePlayer, PtyPort

    try:
        bus = can.Bus(interface=args.interface, channel=args.live)
    except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise TpmsdError(f"{args.interface} {args.live}: cannot be opened: {reason}") from None
    with bus, PtyPort(args.pty) as port:
        device = str(args.pty) if args.pty is not None else port.path
        configuration = live_configuration(spec, args.interface, args.live, device)
        if args.out is not None:
            write_start(args.out, configuration, live_dbc(spec))
            print(f"wrote {args.out / 'vehicle.toml'}", file=sys.stderr, flush=True)
        print(
            f"simulating {spec.duration_s:.0f} s of driving; playing begins after that",
            file=sys.stderr,
            flush=True,
        )
        drive = simulate_drive(spec, motion)
        if args.out is not None:
            _write_folder(args.out, drive, configuration)
        print(f"receiver on {device}, bus on {args.interface} {args.live}", file=sys.stderr, flush=True)
        with Progress(drive.spec.duration_s, "playing") as progress:
            player = LivePlayer(
                drive, bus, port, speedup=args.speed_up, progress=progress.update, newest_only=True
            )
            stats = player.play()
        live = {
            "device": device,
            "frames": stats.frames,
            "send_errors": stats.send_errors,
            "overtaken": stats.overtaken,
            "sentences": stats.sentences,
            "dropped_bytes": port.dropped_bytes,
            "worst_lateness_s": stats.worst_lateness_s,
        }
    return {**report(drive), "live": live}


def _read_vehicle(path: Path | None) -> tuple[VehicleConfig, float, float]:
    """Return the vehicle and the antenna's position, metres forward and left, of a configuration or by
    default."""
    from tpmsd.offline.simulator.drive import DEFAULT_VEHICLE

    if path is None:
        return DEFAULT_VEHICLE, 0.0, 0.0
    from tpmsd.car.config.load import load_config

    config = load_config(path)
    return config.vehicle, config.gnss.antenna_forward_m, config.gnss.antenna_left_m


def _parse_faults(args: argparse.Namespace) -> tuple[Fault, ...]:
    from tpmsd.offline.simulator.faults import Fault

    named = {"puncture": args.puncture, "leak": args.leak, "step": args.step}
    kinds = [(kind, wheel) for kind, wheel in named.items() if wheel is not None]
    if args.diffusion:
        kinds.append(("diffusion", None))
    sizes = {
        "percent": args.loss_percent,
        "mm": args.loss_mm,
        "pressure-percent": args.pressure_percent,
    }
    given = [(value, unit) for unit, value in sizes.items() if value is not None]
    if not kinds:
        if given or args.over is not None or args.at is not None:
            raise ConfigError("a size, --over or --at without --puncture, --leak, --step or --diffusion")
        return ()
    size, unit = given[0] if given else (2.0, "percent")
    kind, wheel = kinds[0]
    if kind != "step" and size < 0.0:
        raise ConfigError(f"a loss of {size:g} {unit} is negative: --step WHEEL makes a radius grow")
    if args.at is not None and not 0.0 <= args.at < args.duration:
        raise ConfigError(
            f"--at {args.at:g}: the fault would not begin within the drive (--duration {args.duration:g})"
        )
    return (
        Fault(
            kind=kind,
            size=size,
            size_unit=unit,
            wheel=wheel,
            onset_s=args.duration / 2 if args.at is None else args.at,
            duration_s=args.over,
        ),
    )


def _parse_four_mm(text: str | None) -> tuple[float, float, float, float] | None:
    if text is None:
        return None
    try:
        fl, fr, rl, rr = (float(word) / 1000.0 for word in text.split(","))
    except ValueError:
        raise ConfigError(f"--radius-offset-mm {text}: four numbers FL,FR,RL,RR are wanted") from None
    if not all(abs(offset) <= 0.05 for offset in (fl, fr, rl, rr)):
        raise ConfigError(f"--radius-offset-mm {text}: more than 50 mm")
    return fl, fr, rl, rr


def _parse_span(text: str) -> tuple[float, float]:
    begin, colon, end = text.partition(":")
    try:
        span = float(begin), float(end)
    except ValueError:
        span = (1.0, 0.0)
    if not colon or span[0] > span[1]:
        raise ConfigError(f"--outage {text}: FROM:TO in seconds is wanted, FROM before TO")
    return span


def _fraction_of_percent(option: str, percent: float) -> float:
    if not 0.0 <= percent <= 100.0:
        raise ConfigError(f"{option} {percent:g} is outside 0 to 100")
    return percent / 100.0


def _nonnegative(option: str, value: float) -> float:
    if not 0.0 <= value < 1e6:
        raise ConfigError(f"{option} {value:g} is not a number of at least 0")
    return value
