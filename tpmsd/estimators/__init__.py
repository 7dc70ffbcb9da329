"""Ticks in, radii of the tyres out: `build.build_estimator` makes the one that the configuration names.

`mpf_rb` is the default; `mpf_pn`, `aug_pf`, `aug_kf` and `mpf_mn` are those that paper 000 compares. All are
`base.Estimator`s.
"""
