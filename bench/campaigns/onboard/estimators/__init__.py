"""Lundquist et al.'s (2013) comparison of estimators, and what goes beyond it: `make bench-estimators`."""
