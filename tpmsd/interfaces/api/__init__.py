"""The Python face of tpmsd: what `import tpmsd` offers, as functions of drives and records of results.

In: drive folders, or arrays and data frames. Out: `Replay`, `Diagnosis`, `Calibration`, each equal to the
JSON of the command of the same name. `tpmsd/__init__.py` re-exports the names on first use, so that the
import itself stays light.
"""
