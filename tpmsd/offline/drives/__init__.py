"""Recorded drives: read from a folder, from files or from arrays, and played through the daemon's own core.

In: a drive folder, two log files, or frames and sentences in memory. Out: `drive.Drive`, `raw_drive.RawDrive`
(without a configuration), and what `playing` makes of them: a replay, an explanation, arrays for inference.
"""
