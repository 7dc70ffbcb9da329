"""Version of the status document, apart from what makes it: who only reads the document needs no more."""

DOCUMENT_VERSION = 1
"""Rises when a field changes its meaning or goes; new fields do not raise it."""
