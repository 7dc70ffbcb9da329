"""Inputs of the program, decoded and stamped: CAN frames, NMEA sentences and whole recorded drives.

In: a bus, a serial line or files. Out: the records of `events`. Modules named in `tests/test_house.py` do the
I/O; the others are pure.
"""
