"""`tpmsd unseal OUT --with REPORT.json`: opens the truth of concealed effects and scores a report.

In: a folder that `tpmsd simulate --onto --conceal` wrote, the JSON of `tpmsd diagnose`. Out: what was
concealed beside what was found, for people and as JSON.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.interfaces.cli.output import Subparsers, add_json_option, json_text
from tpmsd.interfaces.cli.output_files import Outputs

SCHEMA = "tpmsd.unseal/1"
MAX_REPORT_BYTES = 64 << 20
_DESCRIPTION = """\
Opens the sealed truth of a recording in which effects were concealed, and scores the report that was made
before: right names, values in their intervals, misses, and what was named though nobody concealed it.
"""
_EPILOG = """\
examples:
  tpmsd simulate drives/riddle --onto drives/monday --conceal 2
  tpmsd diagnose drives/riddle --json riddle.json
  tpmsd unseal drives/riddle --with riddle.json

  tpmsd diagnose drives/monday --json monday.json     a real drive has effects of its own
  tpmsd unseal drives/riddle --with riddle.json --untouched monday.json
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add `unseal` to the command line."""
    parser = subparsers.add_parser(
        "unseal",
        help="open the truth of concealed effects, and score a report",
        description=_DESCRIPTION,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "folder", type=Path, metavar="OUT", help="folder with truth.sealed, or the file itself"
    )
    parser.add_argument(
        "--with",
        dest="report",
        type=Path,
        metavar="REPORT.json",
        required=True,
        help="what tpmsd diagnose OUT --json wrote",
    )
    parser.add_argument(
        "--untouched",
        type=Path,
        metavar="FILE",
        help="the report of the recording without concealed effects: what stands in it is its own",
    )
    parser.add_argument("--sha256", metavar="HASH", help="refuse a truth that does not have this SHA-256")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Open the sealed truth, score the report, and print the score."""
    from tpmsd.foundation.provenance import provenance
    from tpmsd.offline.report.unsealed import score, unsealed_summary
    from tpmsd.offline.simulator.sealed import SEALED, unseal

    outputs = Outputs(("--json", args.json))
    report = read_report(args.report)  # before the truth is opened
    untouched = None if args.untouched is None else read_report(args.untouched)
    path = args.folder / SEALED if args.folder.is_dir() else args.folder
    truth, sha256 = unseal(path)
    if args.sha256 is not None and args.sha256.lower() != sha256:
        raise InputError(path, f"its SHA-256 is {sha256}: another truth than the one that was sealed")
    document: dict[str, Any] = {
        "sha256": sha256,
        "onto": truth.get("onto"),
        "seed": truth.get("seed"),
        **score(truth, report, untouched),
    }
    outputs.say(unsealed_summary(document, untouched is not None))
    origin = provenance(SCHEMA, [path, args.report], None)
    outputs.write({"--json": lambda: json_text({**origin, **document})})
    return 0


def read_report(path: Path) -> dict[str, Any]:
    """Return the document that `tpmsd diagnose --json` wrote; InputError with one line if it is none."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_REPORT_BYTES + 1)
    except OSError as error:
        raise InputError(path, error.strerror or str(error)) from None
    try:
        if len(data) > MAX_REPORT_BYTES:
            raise ValueError("too large for a report")
        document: Any = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"not JSON: {error}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(schema, str) or not schema.startswith("tpmsd.diagnosis/"):
        raise ConfigError(f"{path}: not a report of tpmsd diagnose --json")
    findings = document.get("findings")
    if not isinstance(findings, list):
        raise ConfigError(f"{path}: a report of tpmsd diagnose has findings")
    return {**document, "findings": findings}
