"""Check that a packed log (BLF, MF4) is what it states, before a library reads it that bounds nothing itself.

In: the file. Out: nothing, or ValueError with what is too large or makes no sense. Every packed block is
unpacked once, in pieces, and thrown away.

- BLF (Vector's binary log; layout after python-can's `can.io.blf`): objects of `LOBJ`, size and type; those
  of type 10 are containers, deflated or not, whose contents joined are again a run of objects. A size of less
  than a header makes a reader go round for ever, a huge one makes it wait and gather; a container may unpack
  to a thousand times its size.
- MF4 (ASAM MDF 4.1): blocks `##DZ` hold up to 4 MiB of data by the standard, with their sizes in front.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO

MAX_CONTAINER_BYTES = 16 << 20
"""Unpacked or not; tools write 128 kB to a few MB."""
MAX_OBJECT_BYTES = 1 << 20
"""A CAN FD message has some 100 bytes, the text of a comment some 10 kB."""
MAX_BLOCK_BYTES = 16 << 20
"""Size of a block of MDF, at most; the standard allows 4 MiB."""
MAX_MF4_BYTES = 256 << 20
"""Size of all blocks unpacked, and of the file, at most: asammdf holds them in memory."""
PIECE_BYTES = 1 << 16
_OBJECT = struct.Struct("<4sHHLL")
_FILE_HEADER_BYTES = 144
_CONTAINER, _CONTAINER_HEADER_BYTES = 10, 16
_DEFLATED = 2
_DZ = struct.Struct("<4s4xQQ2sBBLQQ")


def check_blf(file: BinaryIO) -> None:
    """Raise ValueError for an object of a BLF log whose size is impossible or too large unpacked.

    Other damage is left to the reader to report.
    """
    start = file.read(8)
    if len(start) < 8 or start[:4] != b"LOGG":
        return
    file.seek(max(int.from_bytes(start[4:], "little"), _FILE_HEADER_BYTES))
    objects = _Objects()
    while len(header := file.read(_OBJECT.size)) == _OBJECT.size:
        signature, _, _, size, kind = _OBJECT.unpack(header)
        if signature != b"LOBJ":
            return
        if not _OBJECT.size <= size <= MAX_CONTAINER_BYTES:
            raise ValueError(f"an object of {size} bytes")
        content = file.read(size - _OBJECT.size)
        file.seek(size % 4, 1)
        if kind == _CONTAINER and len(content) >= _CONTAINER_HEADER_BYTES:
            packed = content[_CONTAINER_HEADER_BYTES:]
            deflated = int.from_bytes(content[:2], "little") == _DEFLATED
            for piece in _inflate(packed, MAX_CONTAINER_BYTES, "a container") if deflated else [packed]:
                objects.feed(piece)


def check_mf4(file: BinaryIO) -> None:
    """Raise ValueError if an MF4 log or a packed block in it is larger, unpacked, than it may be."""
    size = file.seek(0, 2)
    if size > MAX_MF4_BYTES:
        raise ValueError(f"{size >> 20} MB; at most {MAX_MF4_BYTES >> 20} MB of MF4 are read at once")
    if size == 0:
        return
    total, at = 0, 0
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        while (at := data.find(b"##DZ", at)) >= 0:
            if at + _DZ.size > size:
                return
            _, _, _, _, _, _, _, unpacked, packed = _DZ.unpack_from(data, at)
            if max(unpacked, packed) > MAX_BLOCK_BYTES:
                raise ValueError(f"a packed block of {max(unpacked, packed)} bytes")
            at += _DZ.size
            pieces = _inflate(data[at : at + packed], MAX_BLOCK_BYTES, "a packed block")
            total += sum(len(piece) for piece in pieces)
            if total > MAX_MF4_BYTES:
                raise ValueError(f"more than {MAX_MF4_BYTES >> 20} MB of data")


def _inflate(packed: bytes, most: int, what: str) -> Iterator[bytes]:
    """Yield deflated data unpacked, in pieces up to any damage; ValueError beyond `most` bytes."""
    unpacker, total = zlib.decompressobj(), 0
    try:
        while packed and not unpacker.eof:
            piece = unpacker.decompress(packed, PIECE_BYTES)
            total += len(piece)
            if total > most:
                raise ValueError(f"{what} that unpacks to more than {most >> 20} MB")
            packed = unpacker.unconsumed_tail
            yield piece
    except zlib.error:
        return


class _Objects:
    """A run of BLF objects that comes in pieces."""

    def __init__(self) -> None:
        self._rest = b""
        self._skip = 0
        """Bytes of the present object that are still to come."""
        self._lost = False
        """True once no object stands where one should: here the reader gives up."""

    def feed(self, piece: bytes) -> None:
        """Follow the objects through a piece of the stream; ValueError for an object of an impossible
        size."""
        data = self._rest + piece
        at = 0
        while not self._lost:
            if self._skip:
                step = min(self._skip, len(data) - at)
                self._skip -= step
                at += step
            if len(data) - at < _OBJECT.size + 8:
                break
            found = data.find(b"LOBJ", at, at + 8)
            if found < 0:
                self._lost = True
                break
            size = _OBJECT.unpack_from(data, found)[3]
            if not _OBJECT.size <= size <= MAX_OBJECT_BYTES:
                raise ValueError(f"an object of {size} bytes")
            at, self._skip = found, size
        self._rest = b"" if self._lost else data[at:]
