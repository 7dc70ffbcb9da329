"""These tests start gpsd, mosquitto and prometheus: `make test-connect` runs them, `make test` does not."""

from __future__ import annotations

import os

collect_ignore_glob = [] if os.environ.get("TPMSD_CONNECT") else ["test_*.py"]
