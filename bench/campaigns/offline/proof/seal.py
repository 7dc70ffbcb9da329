"""The seal: a file whose SHA-256 is known before anybody diagnoses, and that is opened afterwards.

In: a truth as plain numbers, a nonce. Out: its file and hash; later the truth, if the file is still the same.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any


class BrokenSealError(Exception):
    """The sealed file is not the one whose hash was printed."""


@dataclass(frozen=True)
class Seal:
    """A sealed truth."""

    file: Path
    sha256: str


def seal(truth: dict[str, Any], nonce: str, file: Path) -> Seal:
    """Write the truth, readable by its owner alone; the nonce keeps the hash from being guessed."""
    data = json.dumps({"nonce": nonce, "truth": truth}, sort_keys=True).encode("utf-8")
    file.write_bytes(data)
    file.chmod(0o600)
    return Seal(file, hashlib.sha256(data).hexdigest())


def opened(sealed: Seal) -> dict[str, Any]:
    """Return the truth; BrokenSealError where the file was changed after it was sealed."""
    data = sealed.file.read_bytes()
    if hashlib.sha256(data).hexdigest() != sealed.sha256:
        raise BrokenSealError(f"{sealed.file.name} was changed after it was sealed")
    truth: dict[str, Any] = json.loads(data)["truth"]
    return truth
