"""Checks of a drive against a configuration: sides, axles, signs, scales, teeth and clock."""
