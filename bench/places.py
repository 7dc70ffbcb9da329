"""Where things lie: the repository, the real recordings, the results."""

from __future__ import annotations

import os
from pathlib import Path

REPO = Path(__file__).resolve().parent.parent
RECORDINGS = Path(os.environ.get("TPMSD_RECORDINGS", REPO.parent / "shared" / "recordings"))
OUT = REPO / "bench-out"
