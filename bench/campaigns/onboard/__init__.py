"""Campaigns on what runs in the car: decoding, filters, alarms, the daemon."""
