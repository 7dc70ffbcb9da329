"""The torsional resonance of wheel and tyre in wheel-speed jitter: a second witness of a soft tyre.

`watch.ResonanceWatch` takes rotation samples and gives `evidence.ResonanceEvidence`
(docs/explanation/resonance.md).
"""
