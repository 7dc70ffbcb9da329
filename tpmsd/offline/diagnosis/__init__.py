"""The diagnosis: which physics a recorded drive holds that the rolling model leaves out."""
