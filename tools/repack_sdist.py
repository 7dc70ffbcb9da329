"""Packs an sdist again with the times, owners and order that depend on nothing but its content.

In: the path of a .tar.gz; SOURCE_DATE_EPOCH. Out: the file in its place. setuptools writes the times of the
build into it.
"""

from __future__ import annotations

import gzip
import io
import os
import sys
import tarfile
from pathlib import Path


def repacked(packed: bytes, time_s: int) -> bytes:
    """The same members, sorted, nobody's, at one time."""
    out = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(packed), mode="r:gz") as source,
        gzip.GzipFile(filename="", mode="wb", fileobj=out, mtime=time_s) as zipped,
        tarfile.open(fileobj=zipped, mode="w", format=tarfile.PAX_FORMAT) as target,
    ):
        for member in sorted(source.getmembers(), key=lambda each: each.name):
            member.mtime, member.uid, member.gid, member.uname, member.gname = time_s, 0, 0, "", ""
            member.pax_headers = {}
            target.addfile(member, source.extractfile(member) if member.isfile() else None)
    return out.getvalue()


if __name__ == "__main__":
    for name in sys.argv[1:]:
        file = Path(name)
        file.write_bytes(repacked(file.read_bytes(), int(os.environ["SOURCE_DATE_EPOCH"])))
