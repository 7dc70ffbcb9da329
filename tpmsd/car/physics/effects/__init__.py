"""One file per effect; `tpmsd.physics.catalogue` lists them."""
