"""tpmsd: finds soft tyres without pressure sensors.

The flow runs one way, and so do the imports:

    sources -> timeline -> estimators -> monitor -> sinks

`pipeline` strings the pure rooms together; `daemon` and `cli` are the shells that do the I/O.
"""

__version__ = "0.1.0"
