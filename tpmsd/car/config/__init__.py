"""The configuration: what the operator says about car, bus and receiver, checked before anything runs.

In: a TOML file or a drive folder (and, for `check`, the DBC). Out: `model.Config`, or every problem at once.
"""
