"""What lies in `guest` and `package` runs where `make test-hil` has made a place for it, and only there."""

from __future__ import annotations

import os

collect_ignore = [] if os.environ.get("TPMSD_HIL") else ["guest", "package"]
