"""Frames of a recording decoded as arrays, ahead of their time.

In: a `CanDecoder` and a block of frames. Out: `DecodedBlock`: the samples that the decoder would make of the
frames one by one, up to the first frame that is irregular.
"""
