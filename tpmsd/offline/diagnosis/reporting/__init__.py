"""From chosen terms to findings that a reader understands."""
