"""What accelerometers, the steering wheel and the clock tell of their own errors, apart from the windows."""
