"""Hypotheses about the radii, and the one posterior over them."""
