"""Radius estimates in, alarms out: `monitor.Monitor` learns a baseline and judges changes against it."""
