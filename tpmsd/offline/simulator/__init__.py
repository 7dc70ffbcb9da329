"""The simulator: a route, a car, faults, a receiver and a bus, to a drive folder or live."""
