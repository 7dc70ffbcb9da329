"""The version of the program; `tpmsd.__version__` is the same."""

__version__ = "0.2.0"
