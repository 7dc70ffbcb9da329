"""Hypotheses of what may be missing: terms, their responses and what is plausible."""
