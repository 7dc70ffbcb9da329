"""Refinement: what enters nonlinearly, finer shapes, and the point about which all is linear."""
