"""docs/how-to/python.md says what is so."""

from __future__ import annotations

from pathlib import Path

import tpmsd
from tpmsd.tables import columns

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_columns_are_those_of_the_docs() -> None:
    """The table of columns in the docs is the one that the code holds."""
    text = (DOCS / "how-to" / "python.md").read_text(encoding="utf-8")
    _, _, after = text.partition("<!-- columns: begin -->\n")
    assert columns.markdown() + "\n" == after.partition("<!-- columns: end -->")[0]


def test_every_function_is_in_the_docs() -> None:
    """Each public function of `import tpmsd` stands in the docs' table."""
    text = (DOCS / "how-to" / "python.md").read_text(encoding="utf-8")
    functions = [name for name in tpmsd.__all__ if name.islower() and name != "__version__"]

    assert [] == [name for name in functions if f"| `{name}(" not in text]
