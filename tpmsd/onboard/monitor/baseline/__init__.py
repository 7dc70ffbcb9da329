"""The normal radii: what a car has learned, set of tyres by set."""
