"""Rings of a recorded drive: ripple, uneven teeth, lost and added counts, the number of teeth."""
