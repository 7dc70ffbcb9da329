"""The air: its density.

In: nothing. Out: `AIR_KGPM3`.
"""

AIR_KGPM3 = 1.2041
"""Density at 20 degC and 101.325 kPa (ISO 2533), kg/m3."""
