"""Alarms: judged, raised, cleared, explained, kept over restarts."""
