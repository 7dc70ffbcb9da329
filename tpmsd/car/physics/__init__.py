"""The physics: kinematics, the catalogue of effects, and the forward model made of both."""
