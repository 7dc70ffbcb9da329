"""The car's own motion on slipping tyres: a 3-DOF model, and filters that estimate its state."""
