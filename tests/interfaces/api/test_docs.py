"""docs/how-to/python.md says what is so."""

from __future__ import annotations

from pathlib import Path

import tpmsd

DOCS = Path(__file__).resolve().parents[3] / "docs"


def test_every_function_is_in_the_docs() -> None:
    """Each public function of `import tpmsd` stands in the docs' table."""
    text = (DOCS / "how-to" / "python.md").read_text(encoding="utf-8")
    functions = [name for name in tpmsd.__all__ if name.islower() and name != "__version__"]

    assert [] == [name for name in functions if f"| `{name}(" not in text]
