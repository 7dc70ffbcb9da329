"""Car: what is known of a car and of the physics of its wheels. It may import `foundation` alone.

In: `vehicle.toml`, a DBC, a motion. Out: a checked configuration (`config`), what each wheel and instrument
must do in that motion (`physics` with its catalogue of effects), side slip and wheel slips
(`vehicle_state`), and the library of known cars (`cars`, data alone).

To be changed here: an effect is one file of `physics/effects`, a known car one file of `cars`, a key of the
configuration a row of `config`. Nothing here knows of frames, filters or alarms.
"""
