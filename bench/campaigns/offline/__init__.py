"""Campaigns on what is done with whole drives: calibration, diagnosis, discovery, fleets."""
