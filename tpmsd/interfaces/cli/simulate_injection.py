"""`tpmsd simulate OUT --onto DRIVE`: effects injected into a recording, said openly or concealed.

In: the command line. Out: a drive folder, and either its truth.json or a sealed truth with its SHA-256.
"""

from __future__ import annotations

import argparse
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError
from tpmsd.interfaces.cli.output import Progress, json_text
from tpmsd.interfaces.cli.output_files import Outputs

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.interfaces.cli.parser import Parser
    from tpmsd.offline.simulator.inject_recording import InjectionTarget

SCHEMA = "tpmsd.injection/1"
MAX_CONCEALED = 10
"""More effects than any drive shows side by side."""
SALT_BYTES = 16
_OWN = ("out", "force", "seed", "effect", "model", "json", "onto", "conceal", "help", "effects_path")
"""Options that go with a recording; all others are for a simulated drive."""


def add_onto_options(parser: Parser) -> None:
    """Add the options of an injection, behind all others of the command."""
    onto = parser.add_argument_group("into a recording")
    onto.add_argument(
        "--onto",
        metavar="DRIVE",
        type=Path,
        help="inject --effect and --model into this recorded drive; all else stays byte for byte",
    )
    onto.add_argument(
        "--conceal",
        metavar="N",
        type=int,
        help="draw N effects that DRIVE can show instead, and seal the truth: tpmsd unseal opens it",
    )
    others = {dest: parser.get_default(dest) for dest in _option_dests(parser) if dest not in _OWN}
    parser.set_defaults(of_simulation=others)


def _option_dests(parser: Parser) -> list[str]:
    return [action.dest for action in parser._actions]


def run_onto(args: argparse.Namespace) -> int:
    """Inject effects into a recording and write the folder; return the exit code."""
    from tpmsd.car.config.load import load_config
    from tpmsd.foundation.provenance import provenance
    from tpmsd.interfaces.cli.drive_reading import open_drive, read_ticks
    from tpmsd.offline.simulator.inject_recording import (
        InjectionTarget,
        check_target,
        effects_document,
        inject,
        write_truth,
    )

    _check_options(args)
    outputs = Outputs(("--json", args.json))
    check_target(args.out, args.onto, args.force)
    config = load_config(args.onto)
    drive, _ = open_drive(args.onto, config)
    onto = InjectionTarget.of(drive, config, read_ticks(args.onto, config))
    document: dict[str, Any] = {"folder": str(args.out), "onto": str(args.onto)}
    if args.conceal is None:
        model = model_of_options(args)
        changed = inject(onto, model, args.out)
        write_truth(args.out, onto, model)
        document |= {"effects": effects_document(model), "sealed": None, "concealed": None}
    else:
        changed, sha256 = _inject_sealed(args, onto)
        document |= {"effects": [], "sealed": sha256, "concealed": args.conceal}
    document["changed"] = changed
    outputs.say(summary(document))
    origin = provenance(SCHEMA, [args.onto], config.file)
    outputs.write({"--json": lambda: json_text({**origin, **document})})
    return 0


def summary(document: dict[str, Any]) -> str:
    """Return the report in lines for people."""
    lines = []
    for effect in document["effects"]:
        values = ", ".join(f"{key} = {_value_text(value)}" for key, value in effect["parameters"].items())
        lines.append(f"  {effect['name']}" + (f": {values}" if values else ""))
    if document["sealed"] is not None:
        count = document["concealed"]
        lines.append(f"{counted(count, 'effect')} concealed; truth.sealed has the SHA-256")
        lines.append(f"  {document['sealed']}")
    else:
        lines.insert(0, f"injected into {document['onto']}:")
    what = " and ".join(document["changed"]) or "nothing"
    lines.append(f"written to {document['folder']}; changed: {what}")
    if document["sealed"] is not None:
        folder = document["folder"]
        lines.append(f"tpmsd diagnose {folder} --json report.json; tpmsd unseal {folder} --with report.json")
    return "\n".join(lines)


def _inject_sealed(args: argparse.Namespace, onto: InjectionTarget) -> tuple[list[str], str]:
    """Draw effects, inject and seal them; return the changed files and the seal's SHA-256."""
    import numpy as np

    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.offline.planning.conceal import RecordingInformation, draw_effects
    from tpmsd.offline.simulator.inject_recording import effects_document, inject
    from tpmsd.offline.simulator.sealed import SEALED, seal

    seed = secrets.randbits(63) if args.seed is None else args.seed
    with Progress(1.0, "examine") as progress:
        showing = RecordingInformation(onto.recording, progress.update)
        model = ExtendedModel(draw_effects(showing, args.conceal, np.random.default_rng(seed)))
    changed = inject(onto, model, args.out, showing.latency_s)
    truth = {"onto": onto.drive.folder.resolve().name, "seed": seed, "effects": effects_document(model)}
    return changed, seal(args.out / SEALED, truth, secrets.token_bytes(SALT_BYTES))


def _check_options(args: argparse.Namespace) -> None:
    """Raise ConfigError with one line on options that do not go together."""
    if args.onto is None:
        raise ConfigError("--conceal N goes with --onto DRIVE")
    if args.out is None:
        raise ConfigError("tpmsd simulate --onto DRIVE: give a folder OUT")
    for dest, default in args.of_simulation.items():
        if getattr(args, dest) != default:
            option = "--" + dest.replace("_", "-")
            raise ConfigError(f"{option} is of a simulated drive: it does not go with --onto")
    if args.conceal is None:
        if not args.effect and args.model is None:
            raise ConfigError("--onto DRIVE: say what to inject with --effect, --model or --conceal N")
        if args.seed is not None:
            raise ConfigError("--seed goes with --conceal, where something is drawn")
        return
    if args.effect or args.model is not None:
        raise ConfigError("--conceal draws the effects: it does not go with --effect and --model")
    if not 1 <= args.conceal <= MAX_CONCEALED:
        raise ConfigError(f"--conceal {args.conceal}: 1 to {MAX_CONCEALED} effects are concealed")
    if args.seed is not None and args.seed < 0:
        raise ConfigError(f"--seed {args.seed}: a seed is 0 or more")


def model_of_options(args: argparse.Namespace) -> ExtendedModel:
    """Return the effects of --model and --effect; ConfigError with one line on what makes no sense."""
    from tpmsd.car.physics.catalogue import parse_effect
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.car.physics.model_file import load_model

    model = ExtendedModel() if args.model is None else load_model(args.model)
    return model.plus(*(parse_effect(text) for text in args.effect))


def _value_text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
