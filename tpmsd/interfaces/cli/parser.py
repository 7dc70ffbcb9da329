"""The argument parser that every command has: one-line errors, and a help that fits the terminal.

In: what a command declares with argparse. Out: help wrapped to the width, with the exit codes; wrong usage as
a `ConfigError` with one line that names the command and the nearest option, instead of a block of usage.
"""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Iterable
from itertools import groupby
from typing import Any, NoReturn

from tpmsd.car.config.suggest import nearest
from tpmsd.foundation.errors import ConfigError

EXIT_CODES = """\
exit codes:
  0  done
  1  anything else
  2  wrong usage or configuration
  3  unusable input (the message names file, line and reason)
"""
_LONGEST_CHOICES = 24
_HANG = 4


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of descriptions and examples as they are where they fit, and wraps the others."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n".join(indent + line for line in fitted(text, width))

    def _metavar_formatter(self, action: argparse.Action, default_metavar: str) -> Any:
        if action.metavar is None and _has_long_choices(action):
            return super()._metavar_formatter(_without_choices(action), action.dest.upper())
        return super()._metavar_formatter(action, default_metavar)

    def _expand_help(self, action: argparse.Action) -> str:
        text = super()._expand_help(action)
        if action.metavar is None and _has_long_choices(action):
            text += f" (one of: {', '.join(map(str, action.choices or ()))})"
        return text

    def add_usage(
        self,
        usage: str | None,
        actions: Iterable[argparse.Action],
        groups: Iterable[Any],
        prefix: str | None = None,
    ) -> None:
        """Show positional arguments and [OPTIONS]; the options are listed below."""
        listed = list(actions)
        if usage is None and sum(bool(action.option_strings) for action in listed) > 2:
            names = [
                self._format_args(action, str(action.metavar or action.dest.upper()))
                for action in listed
                if not action.option_strings
            ]
            usage = " ".join(["%(prog)s [OPTIONS]", *names])
        super().add_usage(usage, listed, groups, prefix)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line (`ConfigError`), and whose help has the exit codes."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        kwargs["formatter_class"] = HelpFormatter
        epilog = (kwargs.get("epilog") or "").rstrip("\n")
        if "exit codes:" not in epilog:
            kwargs["epilog"] = f"{epilog}\n\n{EXIT_CODES}".lstrip("\n")
        super().__init__(*args, **kwargs)

    def error(self, message: str) -> NoReturn:
        """Raise ConfigError with one line for wrong usage, whatever the arguments hold."""
        raise ConfigError(f"{' '.join(message.split())} (usage: {self.prog} --help)")

    def refuse_unknown(self, unknown: list[str]) -> NoReturn:
        """Raise ConfigError on the first unknown argument, with the nearest option if one is near."""
        first = unknown[0]
        near = nearest(first.partition("=")[0], list(self._option_string_actions))
        hint = f"; did you mean {near}?" if first.startswith("-") and near else ""
        self.error(f"unrecognized argument: {first}{hint}")


def fitted(text: str, width: int) -> list[str]:
    """Return the lines of a help text: long prose is filled again, other lines are wrapped each."""
    out: list[str] = []
    for prose, group in groupby(text.splitlines(), lambda line: bool(line) and not line[0].isspace()):
        lines = list(group)
        if prose and any(len(line) > width for line in lines):
            out += textwrap.wrap(" ".join(lines), width)
        else:
            out += [part for line in lines for part in wrapped(line, width)]
    return out


def wrapped(line: str, width: int) -> list[str]:
    """Return a line of a help text in lines of at most `width` characters, the later ones indented further.

    A comment that stands behind four or more spaces goes onto a line of its own.
    """
    if len(line) <= width:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()))
    hang = indent + " " * _HANG
    body, *comment = re.split(r"(?<=\S) {4,}(?=\S)", line, maxsplit=1)
    if body.strip() and comment:
        return [
            *wrapped(body, width),
            *textwrap.wrap(comment[0], width, initial_indent=hang, subsequent_indent=hang),
        ]
    return textwrap.wrap(line.strip(), width, initial_indent=indent, subsequent_indent=hang)


def _has_long_choices(action: argparse.Action) -> bool:
    return len(",".join(map(str, action.choices or ()))) > _LONGEST_CHOICES


def _without_choices(action: argparse.Action) -> argparse.Action:
    return argparse.Action(action.option_strings, action.dest, nargs=action.nargs)
