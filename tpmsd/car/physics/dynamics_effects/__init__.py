"""Effects of vehicle dynamics, one module each; `tpmsd.car.physics.dynamics_catalogue` finds them."""
