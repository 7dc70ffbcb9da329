"""Changes of an input that keep its form: fields, lines, blocks and checksums, so that readers get further.

In: the kind of an input (`KINDS`), its bytes, a seeded generator. Out: the bytes with one to four changes.
Sentences and UBX frames get the checksum that they should have, packed containers of BLF are unpacked and
packed again, blocks of MF4 and HDF5 are changed in their lengths and links, JSON at a value.
"""

from __future__ import annotations

import copy
import functools
import json
import operator
import random
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from typing import Any

NUMBERS = (
    *(b"0", b"-1", b"1", b"255", b"256", b"65535", b"65536", b"4294967296", b"1e308", b"1e999", b"-0.0"),
    *(b"nan", b"inf", b"", b"9" * 400, b"0x10", b"1_0", b"2147483648", b"-9223372036854775809"),
)
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1e308, -1e308, float("nan"), float("inf"), 10**400, "", "\ud800", "../../evil"),
    *([], {}, [[]], {"a": None}, [0.0] * 5000),
)
_TOKEN = re.compile(rb"[A-Za-z_]+|[-+]?[0-9][-+0-9.eE]*|\s+|.", re.DOTALL)
_BLOCKS = re.compile(
    rb"##[A-Z]{2}|LOBJ|LOGG|OHDR|TREE|HEAP|SNOD|GCOL|FRHP|BTHD|PAR1|PK\x01\x02|PK\x03\x04|PK\x05\x06"
)


def _number(rng: random.Random, size: int) -> bytes:
    """An integer of so many bytes that a length, a count or a link might be."""
    most = (1 << 8 * size) - 1
    value = rng.choice((0, 1, 7, 8, 0xFF, most, most // 2 + 1, most - 7, rng.randrange(1 << 12), 1 << 20))
    return (value & most).to_bytes(size, "little")


def text(data: bytes, rng: random.Random) -> bytes:
    """A number, a word or a line is changed, doubled, dropped or moved."""
    lines = data.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    how = rng.randrange(6)
    if how == 0:
        lines.insert(rng.randrange(len(lines) + 1), lines[at])
    elif how == 1:
        del lines[at]
    elif how == 2:
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    else:
        tokens = _TOKEN.findall(lines[at]) or [b""]
        digits = [k for k, token in enumerate(tokens) if token[-1:].isdigit()]
        k = rng.choice(digits) if digits and how < 5 else rng.randrange(len(tokens))
        tokens[k] = rng.choice(NUMBERS) if how < 5 else rng.choice((b"", tokens[k] * 2, rng.choice(tokens)))
        lines[at] = b"".join(tokens)
    return b"".join(lines)


def _sealed(line: bytes) -> bytes:
    start, star = line.find(b"$"), line.rfind(b"*")
    if not 0 <= start < star:
        return line
    body = line[start + 1 : star]
    end = line[len(line.rstrip(b"\r\n")) :]
    return line[: start + 1] + body + b"*%02X" % functools.reduce(operator.xor, body, 0) + end


def sentences(data: bytes, rng: random.Random) -> bytes:
    """A field of a sentence or a byte of a UBX frame is changed, and its checksum made again."""
    frame = data.find(b"\xb5b")
    if frame >= 0 and len(data) >= frame + 8 and rng.random() < 0.7:
        made = bytearray(data)
        size = min(struct.unpack_from("<H", made, frame + 4)[0], len(made) - frame - 8)
        for _ in range(rng.randint(1, 3)):
            width = rng.choice((1, 2, 4))
            if size >= width:
                at = frame + 6 + rng.randrange(size - width + 1)
                made[at : at + width] = _number(rng, width)
        first = second = 0
        for byte in made[frame + 2 : frame + 6 + size]:
            first = (first + byte) & 0xFF
            second = (second + first) & 0xFF
        made[frame + 6 + size : frame + 8 + size] = bytes((first, second))
        return bytes(made)
    lines = data.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    if lines[at].lstrip().startswith(b"{"):
        return b"".join([*lines[:at], document(lines[at], rng) + b"\n", *lines[at + 1 :]])
    fields = lines[at].split(b",")
    k = rng.randrange(len(fields))
    fields[k] = rng.choice((*NUMBERS, b"N", b"235959.99", b"9060.0", rng.choice(fields), fields[k] + b"9"))
    changed = [*lines[:at], _sealed(b",".join(fields)), *lines[at + 1 :]]
    if rng.random() < 0.3:
        changed.insert(rng.randrange(len(changed)), rng.choice(lines))
    return b"".join(changed)


def frames(data: bytes, rng: random.Random) -> bytes:
    """A frame of the stream (step, identifier, length, payload) is changed, doubled, dropped or moved."""
    units, at = [], 0
    while at + 3 <= len(data):
        size = min(data[at + 2], 64) if data[at + 2] & 0x80 else 8
        units.append(data[at : at + 3 + size])
        at += 3 + size
    if not units:
        return bytes((2, rng.randrange(5), 8)) + rng.randbytes(8)
    k, how = rng.randrange(len(units)), rng.randrange(4)
    if how == 0:
        units[k:k] = [units[k]] * rng.choice((1, 3, 40))
    elif how == 1:
        del units[k]
    elif how == 2:
        units[k] = bytes((rng.randrange(256),)) + units[k][1:]
    else:
        head, payload = units[k][:3], bytearray(units[k][3:])
        if payload:
            width = rng.choice((1, 2))
            place = rng.randrange(len(payload))
            payload[place : place + width] = _number(rng, width)
        units[k] = head + bytes(payload)
    return b"".join(units)


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from _places(value[key])


def document(data: bytes, rng: random.Random) -> bytes:
    """A value of a JSON document is changed, dropped, doubled or exchanged."""
    try:
        made = json.loads(data)
    except (ValueError, RecursionError):
        return text(data, rng)
    if not isinstance(made, dict | list) or not made:
        return json.dumps(rng.choice(VALUES)).encode()
    container, key = rng.choice(list(_places(made)))
    how = rng.randrange(4)
    if how == 0 and isinstance(container, dict):
        del container[key]
    elif how == 1 and isinstance(container, list):
        container.insert(key, copy.deepcopy(container[key]))
    elif how == 2:
        other, name = rng.choice(list(_places(made)))
        container[key] = copy.deepcopy(other[name])
    else:
        container[key] = copy.deepcopy(rng.choice(VALUES))
    return json.dumps(made).encode()


def blocks(data: bytes, rng: random.Random) -> bytes:
    """An integer near the head of a block is changed, linked to another block, or a block is doubled."""
    made = bytearray(data)
    heads = [found.start() for found in _BLOCKS.finditer(data)] or [0]
    at = rng.choice(heads)
    how = rng.randrange(5)
    if how == 0 and (opened := _repacked(data, rng)) is not None:
        return opened
    width = rng.choice((1, 2, 4, 8))
    place = at + 4 + width * rng.randrange(max(96 // width, 1))
    if how == 1:
        made[place : place + 8] = rng.choice(heads).to_bytes(8, "little")
    elif how == 2 and len(heads) > 1:
        low = rng.choice(heads)
        high = min((head for head in heads if head > low), default=len(made))
        made[at:at] = made[low:high]
    else:
        made[place : place + width] = _number(rng, width)
    return bytes(made)


def _repacked(data: bytes, rng: random.Random) -> bytes | None:
    """A zlib stream is unpacked, changed and packed again; None where there is none."""
    for found in re.finditer(rb"\x78[\x01\x5e\x9c\xda]", data):
        unpacker = zlib.decompressobj()
        try:
            plain = unpacker.decompress(data[found.start() :], 1 << 20)
        except zlib.error:
            continue
        changed = bytearray(plain)
        width = rng.choice((1, 2, 4))
        if len(changed) > width:
            heads = [head.start() for head in _BLOCKS.finditer(plain)] or [0]
            place = min(rng.choice(heads) + rng.randrange(64), len(changed) - width)
            changed[place : place + width] = _number(rng, width)
        packed = zlib.compress(bytes(changed))
        return data[: found.start()] + packed + unpacker.unused_data
    return None


def footer(data: bytes, rng: random.Random) -> bytes:
    """Bytes of a Parquet file's metadata, at its end, are changed; magic and length stay."""
    if len(data) < 16:
        return data + b"PAR1"
    made = bytearray(data)
    size = max(min(struct.unpack_from("<I", made, len(made) - 8)[0], len(made) - 12), 1)
    low = len(made) - 8 - size if rng.random() < 0.8 else 4
    place = rng.randrange(low, len(made) - 8)
    width = rng.choice((1, 1, 2, 4))
    made[place : place + width] = _number(rng, width)
    return bytes(made)


Change = Callable[[bytes, random.Random], bytes]
KINDS: dict[str, Change] = {
    **dict.fromkeys(("nmea", "receiver", "nmea_log"), sentences),
    **dict.fromkeys(("can", "ticks"), frames),
    **dict.fromkeys(("candump", "asc", "trc", "dbc", "vbo", "toml", "model", "csv", "map"), text),
    **dict.fromkeys(("signals", "dynamics", "dynamics_model"), text),
    **dict.fromkeys(("blf", "mf4", "hdf5", "fmu"), blocks),
    **dict.fromkeys(("state", "status", "store", "retained"), document),
    "parquet": footer,
}
"""The change of form that fits each target."""


def mutated(name: str, data: bytes, rng: random.Random, max_bytes: int) -> bytes:
    """Return the input of this target with one to four changes, of at most so many bytes."""
    for _ in range(rng.randint(1, 4)):
        data = KINDS[name](data, rng)
    return data[:max_bytes]
