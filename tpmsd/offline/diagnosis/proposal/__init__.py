"""Closed forms for what no effect of the catalogue explains."""
