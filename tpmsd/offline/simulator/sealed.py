"""The sealed truth of concealed effects.

In: what was concealed. Out: a file that nobody reads by accident, and whose SHA-256 binds whoever sealed it:
128 random bits in it keep its content from being guessed by the hash. A seal is no secrecy: `tpmsd unseal`
opens it for anybody.

    tpmsd sealed truth 1
    <base64 of a JSON document, compressed by zlib, 76 characters a line>
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import InputError, TpmsdError

SEALED = "truth.sealed"
HEAD = "tpmsd sealed truth 1"
MAX_BYTES = 1 << 20
"""Size of the file, and of its unpacked content, at most: a truth has some thousand."""


def seal(path: Path, document: dict[str, Any], salt: bytes) -> str:
    """Write the sealed file and return its SHA-256 in hexadecimal; `salt` is random."""
    packed = zlib.compress(json.dumps({"salt": salt.hex(), **document}).encode("utf-8"))
    data = f"{HEAD}\n".encode("ascii") + base64.encodebytes(packed)
    try:
        path.write_bytes(data)
    except OSError as error:
        raise TpmsdError(f"{path}: cannot be written: {error.strerror}") from None
    return hashlib.sha256(data).hexdigest()


def unseal(path: Path) -> tuple[dict[str, Any], str]:
    """Return the document in a sealed file, and the file's SHA-256; InputError with one line if it is
    none."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(path, error.strerror or str(error)) from None
    head, _, rest = data.partition(b"\n")
    if head.decode("latin-1").strip() != HEAD or len(data) > MAX_BYTES:
        raise InputError(path, "not a truth that tpmsd simulate --conceal sealed")
    try:
        unpacker = zlib.decompressobj()
        packed = base64.b64decode(rest.translate(None, b"\r\n"), validate=True)
        text = unpacker.decompress(packed, MAX_BYTES)
        if not unpacker.eof:
            raise ValueError("it is cut short, or unpacks to more than a truth is")
        document = json.loads(text)
    except (binascii.Error, zlib.error, ValueError, RecursionError) as error:
        raise InputError(path, f"the seal is broken: {error}") from None
    if not isinstance(document, dict) or not _has_effects(document):
        raise InputError(path, "the seal is broken: it holds no truth")
    return document, hashlib.sha256(data).hexdigest()


def _has_effects(document: dict[str, Any]) -> bool:
    effects = document.get("effects")
    return isinstance(effects, list) and all(
        isinstance(one, dict) and isinstance(one.get("name"), str) and isinstance(one.get("parameters"), dict)
        for one in effects
    )
