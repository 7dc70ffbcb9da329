"""Errors of accelerometers, the steering wheel and the clock, told by themselves apart from the windows."""
