"""Robustness of the findings against other noise, and their certificate."""
