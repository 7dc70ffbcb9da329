"""Malfunctions: signals, encoders and configuration that keep the monitor from its work."""
