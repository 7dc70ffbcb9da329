"""Offline: what is done after the drive, on whole drives. It may import `onboard`, `car` and `foundation`.

In: recorded drives, users' tables, a route. Out: records and documents: radii and tracks (`calibration`),
missing physics (`diagnosis` on the core of `inference`, `planning` for the drive that would identify more),
an unknown car's signals (`discovery`), many drives of many cars (`fleet`), simulated drives (`simulator`).
`drives` reads a drive and plays it through the daemon's own core, `tables` converts from and to other tools'
formats, `report` renders results.

To be changed here: statistics and what is reported of them. Nothing here runs in the car: heavier packages
are welcome where they are used, and imported there.
"""
