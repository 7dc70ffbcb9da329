"""Samples of a drive: conditions, slip and noise under which radii are compared."""
