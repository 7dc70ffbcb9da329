"""Writes the manual pages tpmsd.1 and tpmsd-COMMAND.1 from the parser into a folder.

In: the folder. Out: the files. The date is that of the sources (SOURCE_DATE_EPOCH), so that the same
sources make the same pages.
"""

from __future__ import annotations

import argparse
import os
import sys
from datetime import UTC, datetime
from pathlib import Path

from tpmsd import __version__
from tpmsd.interfaces.cli.main import full_parser


def escaped(text: str) -> str:
    """Text for troff: nothing in it is a request or an escape."""
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq")
    return "\n".join("\\&" + line if line.startswith(".") else line for line in text.split("\n"))


def page(name: str, summary: str, parser: argparse.ArgumentParser) -> str:
    """One manual page, its sections as `man` has them."""
    day = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), UTC).date()
    title = name.replace(" ", "-").upper()
    out = [f'.TH {title} 1 "{day}" "tpmsd {__version__}" "User Commands"', ".SH NAME"]
    out += [
        f"{escaped(name.replace(' ', '-'))} \\- {escaped(summary)}",
        ".SH SYNOPSIS",
        f".B {escaped(name)}",
    ]
    out += ["[OPTIONS] " + " ".join(_metavar(each) for each in parser._actions if not each.option_strings)]
    out += [".SH DESCRIPTION", escaped(parser.description or "")]
    for group in parser._action_groups:
        actions = [each for each in group._group_actions if each.help != argparse.SUPPRESS]
        if not actions or isinstance(actions[0], argparse._SubParsersAction):
            continue
        out.append(f".SH {escaped((group.title or '').upper())}")
        for each in actions:
            names = ", ".join(each.option_strings) or _metavar(each)
            value = f" {_metavar(each)}" if each.option_strings and each.nargs != 0 else ""
            out += [".TP", f".B {escaped(names + value)}", escaped(_help(parser, each))]
    for each in (action for action in parser._actions if isinstance(action, argparse._SubParsersAction)):
        out.append(".SH COMMANDS")
        for choice in each._choices_actions:
            out += [".TP", f".B {escaped(choice.dest)}", escaped(choice.help or "")]
    if parser.epilog:
        out += [".SH EXAMPLES AND EXIT CODES", ".nf", escaped(parser.epilog.rstrip()), ".fi"]
    return "\n".join(out) + "\n"


def _metavar(action: argparse.Action) -> str:
    name = action.metavar or action.dest.upper()
    return name if isinstance(name, str) else " ".join(name)


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return " ".join((parser._get_formatter()._expand_help(action) if action.help else "").split())


def pages() -> dict[str, str]:
    """File name -> text, of the program and each command."""
    parser = full_parser()
    (group,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
    found = {"tpmsd.1": page("tpmsd", "finds soft tyres without pressure sensors", parser)}
    for choice in group._choices_actions:
        name = choice.dest
        found[f"tpmsd-{name}.1"] = page(f"tpmsd {name}", choice.help or name, group.choices[name])
    return found


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in pages().items():
        (folder / file).write_text(text, encoding="utf-8")
