"""Assessment: what was reached, what is left, and how well values are known."""
