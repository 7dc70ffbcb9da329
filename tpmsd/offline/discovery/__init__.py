"""Content of a car's bus, found from a drive: the wheels' signals, other roles, the car's geometry.

In: frames and fixes of a drive, a DBC where there is one. Out: `result.BusDiscovery`.
"""
