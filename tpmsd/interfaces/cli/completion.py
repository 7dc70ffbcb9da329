"""`tpmsd completion SHELL`: completions of commands, options and their choices for bash, zsh and fish.

In: the shell's name. Out: a script on standard output, made from the parser, so that it knows what the
program knows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

from tpmsd.interfaces.cli.output import Subparsers

SHELLS = ("bash", "zsh", "fish")
_EPILOG = """\
examples:
  tpmsd completion bash > ~/.local/share/bash-completion/completions/tpmsd
  tpmsd completion zsh > ~/.zfunc/_tpmsd
  tpmsd completion fish > ~/.config/fish/completions/tpmsd.fish

exit codes: 0 done, 2 wrong usage
"""


def _effect_names() -> tuple[str, ...]:
    from tpmsd.car.physics.catalogue import EFFECTS

    return tuple(EFFECTS)


SUGGESTED: dict[tuple[str, str], Callable[[], tuple[str, ...]]] = {
    ("effects", "name"): _effect_names,
    ("plan", "effects"): _effect_names,
    ("simulate", "effect"): _effect_names,
}
"""Command and argument -> words that are offered for it, where the parser itself takes any."""


@dataclass(frozen=True)
class Command:
    """One command as completions see it."""

    name: str
    help: str
    options: tuple[tuple[str, str, tuple[str, ...]], ...]
    """Option, help, choices."""
    words: tuple[str, ...]
    """Choices of its positional arguments: sub-commands, such as those of `fleet`."""


def add_parser(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "completion",
        help="a completion script for bash, zsh or fish",
        description="Write a script that completes commands, options and choices.",
        epilog=_EPILOG,
    )
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or fish")


def run(args: argparse.Namespace) -> int:
    """Write the completion script of a shell."""
    from tpmsd.interfaces.cli.main import full_parser

    scripts = {"bash": bash, "zsh": zsh, "fish": fish}
    print(scripts[args.shell](commands_of(full_parser())), end="")
    return 0


def commands_of(parser: argparse.ArgumentParser) -> list[Command]:
    """Return all commands of a parser, in its order."""
    found = []
    (group,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    helps = {choice.dest: choice.help or "" for choice in group._choices_actions}
    for name, each in group.choices.items():
        options: list[tuple[str, str, tuple[str, ...]]] = []
        words: list[str] = []
        for action in each._actions:
            choices = tuple(map(str, action.choices or SUGGESTED.get((name, action.dest), tuple)()))
            if action.option_strings:
                options.append((action.option_strings[-1], _unquoted_line(action.help), choices))
            else:
                words += choices
        found.append(Command(name, _unquoted_line(helps.get(name)), tuple(options), tuple(words)))
    return found


def _unquoted_line(text: str | None) -> str:
    """Return a help text on one line, without characters that the three shells treat specially."""
    return " ".join((text or "").split()).translate(str.maketrans("", "", "'\"`$\\[]:")).replace("%%", "%")


def bash(commands: list[Command]) -> str:
    """Return bash's completion script: a function for `complete -F`; where nothing fits, files are
    completed."""
    lines = [
        "# bash completion of tpmsd",
        "_tpmsd() {",
        '    local cur="${COMP_WORDS[COMP_CWORD]}" prev words=""',
    ]
    lines += ['    prev="${COMP_WORDS[COMP_CWORD-1]}"', "    if [ $COMP_CWORD -eq 1 ]; then"]
    lines += [f'        words="{" ".join(each.name for each in commands)} --help --version"']
    lines += ["    else", '        case "${COMP_WORDS[1]}:$prev" in']
    for each in commands:
        for option, _, choices in each.options:
            if choices:
                lines.append(f'            {each.name}:{option}) words="{" ".join(choices)}" ;;')
    for each in commands:
        words = " ".join([*each.words, *(option for option, _, _ in each.options)])
        lines.append(f'            {each.name}:*) words="{words}" ;;')
    lines += ["        esac", "    fi", '    COMPREPLY=($(compgen -W "$words" -- "$cur"))', "}"]
    return "\n".join([*lines, "complete -o bashdefault -o default -F _tpmsd tpmsd"]) + "\n"


def zsh(commands: list[Command]) -> str:
    """Return zsh's completion script: a function for its completion system."""
    lines = ["#compdef tpmsd", "_tpmsd() {", "  if (( CURRENT == 2 )); then", "    local -a found=("]
    lines += [f"      '{each.name}:{each.help}'" for each in commands]
    lines += ["    )", "    _describe command found", "    return", "  fi", "  case $words[2] in"]
    for each in commands:
        lines += [f"    {each.name})", "      shift words; (( CURRENT-- ))", "      _arguments \\"]
        for option, text, choices in each.options:
            value = f":value:({' '.join(choices)})" if choices else ""
            lines.append(f"        '{option}[{text}]{value}' \\")
        words = f"'1:what:({' '.join(each.words)})' " if each.words else ""
        lines += [f"        {words}'*:file:_files' ;;"]
    return "\n".join([*lines, "  esac", "}", '_tpmsd "$@"']) + "\n"


def fish(commands: list[Command]) -> str:
    """Return fish's completion script: one `complete` per command and option."""
    lines = ["# fish completion of tpmsd"]
    for each in commands:
        lines.append(f"complete -c tpmsd -n __fish_use_subcommand -f -a {each.name} -d '{each.help}'")
        seen = f"-n '__fish_seen_subcommand_from {each.name}'"
        for word in each.words:
            lines.append(f"complete -c tpmsd {seen} -f -a {word}")
        for option, text, choices in each.options:
            name = f"-l {option[2:]}" if option.startswith("--") else f"-s {option[1:]}"
            values = f" -x -a '{' '.join(choices)}'" if choices else ""
            lines.append(f"complete -c tpmsd {seen} {name} -d '{text}'{values}")
    return "\n".join(lines) + "\n"
