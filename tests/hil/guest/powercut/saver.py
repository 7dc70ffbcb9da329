"""In the guest: reads the state on /disk as the daemon does, says which it is, saves without a pause.

Out: /out/found, the number of the state found (0: none); /out/saved, the number last reported as saved.
Both go to the machine outside, whose power is not cut.
"""

from __future__ import annotations

import os
from pathlib import Path

from tpmsd.onboard.sinks.state_file import load_state, save_state

STATE = Path("/disk/state.json")
BALLAST = 30_000
"""Bytes of a state of usual size."""


def tell(name: str, number: int) -> None:
    """Write a number to the outside, at once and as a whole."""
    descriptor = os.open(f"/out/{name}", os.O_WRONLY | os.O_CREAT, 0o644)
    os.pwrite(descriptor, f"{number:09d}\n".encode("ascii"), 0)
    os.fsync(descriptor)
    os.close(descriptor)


def main() -> None:
    """Until the power is cut."""
    payload = load_state(STATE)
    number = 0 if payload is None else int(payload["number"])
    if payload is not None:
        assert payload["ballast"] == str(number % 10) * BALLAST, "half of one state and half of another"
    if [path.name for path in STATE.parent.iterdir() if "damaged" in path.name]:
        print("damaged state set aside")
    tell("found", number)
    while True:
        number += 1
        save_state(STATE, {"number": number, "ballast": str(number % 10) * BALLAST})
        tell("saved", number)


main()
