"""The calibration room: recorded drives in, radii and tracks with their uncertainty out."""
