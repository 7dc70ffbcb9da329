"""Why a mutant of the published sample survives: a piece of its change, and the reason.

A reason that begins with `same` says that the mutant does the same as the program.
"""

from __future__ import annotations

REASONS: dict[str, str] = {}
