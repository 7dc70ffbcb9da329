"""Onboard: what runs in the car, tick by tick. With `car` and `foundation` it is all that the daemon needs.

In: CAN frames and the receiver's sentences, with their host time. Out: alarms, CAN frames, the status socket,
the state file. One direction of flow, and imports in that order:

    sources -> timeline -> estimators -> monitor -> sinks

`resonance` is evidence apart from the radii, `pipeline` joins the pure packages for live and replay alike,
and `daemon` is the event loop around it.

To be changed here: decoding, filters, alarms. `sources`, `timeline`, `estimators`, `monitor`, `resonance` and
`pipeline` do no I/O, read no clock and are given their randomness; a box has little memory and one slow core.
"""
