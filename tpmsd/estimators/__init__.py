"""Ticks in, radii of the tyres out: `build.build_estimator` makes the one that the configuration names.

`mpf_rb` is the default, `mpf_pn` the filter of paper 000 as published; both are `base.Estimator`s.
"""
