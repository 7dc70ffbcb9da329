"""Tests of `tpmsd.bridges` without a network."""
