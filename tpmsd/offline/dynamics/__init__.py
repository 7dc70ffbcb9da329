"""The diagnosis of vehicle dynamics: which physics a recorded drive holds that a baseline leaves out."""
