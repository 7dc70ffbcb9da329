"""Tests of `tpmsd.interfaces.bridges` without a network."""
