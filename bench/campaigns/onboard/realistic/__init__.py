"""Sixteen realistic cases of soft tyres, for this program and for any other system on a CAN bus."""
