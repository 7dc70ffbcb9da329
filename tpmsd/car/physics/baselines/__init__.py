"""Baseline models of vehicle dynamics: states, inputs, outputs, a step and what is read of it."""
