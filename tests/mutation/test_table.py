"""What counts as a mutant, and paths of the table."""

from __future__ import annotations

from tests.mutation.run import REPO, behaviour, named, page, printed
from tests.mutation.table import NAMED, PACKAGES


def test_modules_and_tests_of_the_packages_exist() -> None:
    """Every path that the table names is there."""
    paths = [path for package in PACKAGES.values() for path in (*package.modules, *package.tests)]
    paths += [path.partition("::")[0] for one in NAMED for path in one.tests]
    assert [] == [path for path in paths if not (REPO / path).exists()]


def test_mutations_by_name_are_of_the_program_as_it_is() -> None:
    """Each changes text that its module holds once, and what is left is a program that acts otherwise."""
    mutants = named()
    assert len(NAMED) == len(mutants)
    for module, text, _ in mutants:
        assert behaviour(text) not in ("", behaviour((REPO / module).read_text("utf-8")))


def test_what_is_no_behaviour_makes_no_mutant() -> None:
    """Annotations, docstrings and decorators are left out of the comparison; numbers and calls are not."""
    one = 'def f(a: int | None = 1) -> int:\n    """Adds."""\n    return a + 1\n'
    other = '@cached\ndef f(a: int & None = 1) -> str:\n    """Takes."""\n    return a + 1\n'
    assert behaviour(one) == behaviour(other)
    assert behaviour(one) != behaviour(one.replace("a + 1", "a - 1"))
    assert "" == behaviour("def")


def test_a_printed_run_gives_its_tables() -> None:
    """Survivors belong to the package whose number follows them; a cell of the table holds no bar of its
    own."""
    text = "  survived: a.py:3  - x | y   + x & y\nepochs          39 of  40 killed\nlinks 2 of 2 killed\n"
    epochs, links = printed(text)
    assert (("epochs", 40, 39), ("links", 2, 2)) == tuple((r.name, r.seen, r.dead) for r in (epochs, links))
    assert "| `a.py:3` | `x \\|` to `x &` | missed |" in page([epochs, links], 40, 1).splitlines()
