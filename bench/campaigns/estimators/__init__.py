"""Paper 000's comparison of estimators, and what goes beyond it: `make bench-estimators`."""
