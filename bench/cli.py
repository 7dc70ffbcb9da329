"""`python -m bench list | run NAME | report NAME`: the one command line of all campaigns."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.places import OUT, REPO
from bench.registry import CAMPAIGNS, UsageError
from tpmsd.interfaces.cli.output import write_json


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
    report = commands.add_parser(
        "report", help="the tables of a campaign's results, for its page of bench/results/"
    )
    report.add_argument("name", choices=[each.name for each in CAMPAIGNS.values() if each.page])
    report.add_argument("--out", type=Path, help="where the results lie (bench-out/NAME)")
    report.add_argument("--write", action="store_true", help="put them into the page, between its marks")
    report.set_defaults(parser=report)
    return parser


def into_page(page: str, name: str, table: str) -> str:
    """A page with what stands between a campaign's marks exchanged; UsageError without the marks."""
    begin, end = f"<!-- python -m bench report {name} -->", f"<!-- end of {name} -->"
    head, found, rest = page.partition(begin)
    _, closed, tail = rest.partition(end)
    if not found or not closed:
        raise UsageError(f"the page has no marks {begin} and {end}")
    return f"{head}{begin}\n\n{table.strip()}\n\n{end}{tail}"


def _report(args: argparse.Namespace) -> int:
    campaign = CAMPAIGNS[args.name]
    text = campaign.report(args.out or OUT / args.name)
    if args.write:
        page = REPO / "bench" / "results" / campaign.page
        page.write_text(into_page(page.read_text(encoding="utf-8"), args.name, text), encoding="utf-8")
    else:
        print(text)
    return 0


def parse(words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line, without the program's name."""
    return parser_of(words).parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    """The command; its exit code."""
    args = parse(sys.argv[1:] if words is None else words)
    if args.command == "list":
        for campaign in CAMPAIGNS.values():
            print(f"{campaign.name:18} {campaign.summary}")
        return 0
    try:
        result: Any = _report(args) if args.command == "report" else CAMPAIGNS[args.name].main(args)
    except UsageError as error:
        args.parser.error(str(error))
    if isinstance(result, int):
        return result
    if args.json is not None:
        write_json(result, args.json)
    return 0
