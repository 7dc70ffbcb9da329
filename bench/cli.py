"""`python -m bench list | run NAME | report NAME`: the one command line of all campaigns."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from bench.registry import CAMPAIGNS, UsageError
from tpmsd.cli.output import write_json


def parser_of(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser; only the campaign that `words` name is imported for its options."""
    parser = argparse.ArgumentParser(prog="python -m bench", description="Benchmarks of tpmsd.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("list", help="the campaigns, one line each")
    run = commands.add_parser("run", help="run a campaign")
    names = run.add_subparsers(dest="name", required=True, metavar="NAME")
    for campaign in CAMPAIGNS.values():
        wanted = campaign.name in words
        each = names.add_parser(
            campaign.name,
            help=campaign.summary,
            description=campaign.about if wanted else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if wanted:
            campaign.options(each)
            each.add_argument(
                "--json", metavar="FILE", help="write the result as JSON ('-': standard output)"
            )
            each.set_defaults(parser=each)
    return parser


def parse(words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line, without the program's name."""
    return parser_of(words).parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    """The command; its exit code."""
    import sys

    args = parse(sys.argv[1:] if words is None else words)
    if args.command == "list":
        for campaign in CAMPAIGNS.values():
            print(f"{campaign.name:18} {campaign.summary}")
        return 0
    try:
        result: Any = CAMPAIGNS[args.name].main(args)
    except UsageError as error:
        args.parser.error(str(error))
    if isinstance(result, int):
        return result
    if args.json is not None:
        write_json(result, args.json)
    return 0
