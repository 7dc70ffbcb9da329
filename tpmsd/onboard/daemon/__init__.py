"""The daemon: one event loop around the pure pipeline.

In: a bus, a receiver, signals. Out: alarms on the bus, the status socket, the journal, the state file.
"""
