"""Power cuts while the state is saved: a guest saves to an ext4 image without a pause, and is killed.

In: the folder for images and logs. Out: how many cuts there were, and what was wrong after them. After each
cut the next guest mounts the image, reads the state as the daemon does, and goes on saving. The state must
be the one that was last reported as saved, or the one that was being saved then.
"""

from __future__ import annotations

import random
import shutil
import subprocess
import time
from pathlib import Path

from tests.hil import uml
from tests.hil.prepare import REPO

CUTS = 6
SAVER = REPO / "tests" / "hil" / "guest" / "powercut" / "saver.py"
IMAGE_MB = 16
PATIENCE_S = 60.0


def run(folder: Path, stage: Path, build: Path) -> tuple[int, list[str]]:
    """All cuts, each at another moment of the saving."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    image = folder / "disk.img"
    with image.open("wb") as file:
        file.truncate(IMAGE_MB << 20)
    make = shutil.which("mkfs.ext4", path="/usr/sbin:/sbin:/usr/bin:/bin")
    if make is None:
        raise uml.HilError("no mkfs.ext4; on Debian: apt-get install e2fsprogs")
    subprocess.run([make, "-q", "-F", str(image)], check=True, capture_output=True)
    moments = random.Random(1)
    problems, reported = [], 0
    for cut in range(CUTS + 1):
        out = folder / f"boot-{cut}"
        job = f"exec >/out/job.log 2>&1\nexec /usr/lib/tpmsd/bin/python {SAVER}\n"
        with uml.guest(job, out=out, stage=stage, disk=image, memory="128M", build=build) as guest:
            found = wait_for_number(guest, out / "found")
            if found is None:
                problems.append(f"boot {cut}: the saver did not start\n{guest.tail()}")
                break
            if cut and not reported <= found <= reported + 1:
                problems.append(
                    f"cut {cut}: state {found} after {reported} was reported as saved\n{guest.tail()}"
                )
            # Until a few more are saved, then until some moment within the saving.
            wait_for_number(guest, out / "saved", found + 3)
            time.sleep(moments.uniform(0.0, 0.2))
            guest.cut_power()
            reported = number(out / "saved") or found
        if not cut:
            continue
        if "damaged" in (out / "job.log").read_text("utf-8", "replace"):
            problems.append(f"cut {cut}: a damaged state")
    return CUTS, problems


def number(file: Path) -> int | None:
    """The number in a file; None while there is none."""
    try:
        return int(file.read_text("ascii"))
    except (OSError, ValueError):
        return None


def wait_for_number(guest: uml.Guest, file: Path, least: int = 0) -> int | None:
    """The number once it is that great; None if the guest ends or takes too long."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s and guest.process.poll() is None:
        found = number(file)
        if found is not None and found >= least:
            return found
        time.sleep(0.02)
    return None
