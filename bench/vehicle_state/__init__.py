"""An observer of slips that only benchmarks use; the filters are in `tpmsd.car.vehicle_state`."""
