"""The JSON Schemas of the documents that tpmsd writes, by the name in their key `schema`, such as
`tpmsd.replay/2`.

In: a name. Out: the schema (draft 2020-12). A schema changes with its version: keys are added under a new
number, none is taken away within one. `tests/foundation/test_schemas.py` validates every document against
its schema.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

NAMES = (
    "tpmsd.calibration/2",
    "tpmsd.check/2",
    "tpmsd.diagnosis/2",
    "tpmsd.discovery/2",
    "tpmsd.explanation/1",
    "tpmsd.fleet.add/1",
    "tpmsd.fleet.drive/1",
    "tpmsd.fleet.report/1",
    "tpmsd.fleet.run/1",
    "tpmsd.fleet.sql/1",
    "tpmsd.fleet.status/1",
    "tpmsd.import/1",
    "tpmsd.injection/1",
    "tpmsd.mqtt/1",
    "tpmsd.plan/1",
    "tpmsd.replay/2",
    "tpmsd.reset/2",
    "tpmsd.simulation/2",
    "tpmsd.status/2",
    "tpmsd.unseal/1",
)


@cache
def schema_of(name: str) -> dict[str, Any]:
    """Return the schema of a name; KeyError if it is none of `NAMES`."""
    if name not in NAMES:
        raise KeyError(name)
    text = files(__name__).joinpath(name.replace("/", ".") + ".json").read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema
