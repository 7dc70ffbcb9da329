"""One file per effect; `tpmsd.car.physics.catalogue` lists them."""
