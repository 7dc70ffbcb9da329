"""Errors of accelerometers, the steering wheel and the clock, estimated by themselves, apart from the
windows."""
