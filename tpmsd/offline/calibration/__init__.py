"""Calibration: recorded drives in, radii and tracks with their uncertainty out."""
