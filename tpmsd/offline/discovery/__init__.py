"""Content of a car's bus, found from a drive: wheels, their roles, the car's geometry, wrong configurations.

In: frames and fixes of a drive, a DBC where there is one. Out: `result.Discovery` and `suspicions.Suspicion`.
"""
