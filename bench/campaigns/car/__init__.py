"""Campaigns on what is known of a car: vehicle state."""
