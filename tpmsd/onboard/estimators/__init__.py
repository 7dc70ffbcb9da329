"""Ticks in, radii of the tyres out: `build.build_estimator` makes the one that the configuration names.

A `radius_filter.RadiusFilter` keeps gates, pose and snapshots, and delegates to a `belief.Belief` made of
pieces; `table` says which pieces the published filters are made of. `gaussian-sum` is the default.
"""
