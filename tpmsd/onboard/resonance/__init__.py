"""The torsional resonance of wheel and tyre in wheel-speed jitter: evidence of a soft tyre apart from the
radii.

`watch.ResonanceWatch` takes rotation samples and gives `evidence.ResonanceEvidence`
(docs/explanation/resonance.md).
"""
