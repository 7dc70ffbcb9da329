"""Progress of a store.

In: a store. Out: counts as a document of plain values.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from tpmsd.offline.fleet.store import Store
from tpmsd.offline.fleet.work import program


def status_document(store: Store) -> dict[str, Any]:
    """Return the numbers of drives by state, cars and models, and the store's size on the disk."""
    entries = store.entries()
    states: Counter[str] = Counter()
    other = 0
    failed = []
    for entry in entries:
        result = store.result(entry.key)
        state = "missing" if result is None else str(result.get("status"))
        states[state] += 1
        other += result is not None and result.get("program") != program()
        if result is not None and state in ("failed", "set_aside"):
            shown = {"key": entry.key, "car": entry.car, "path": entry.path, "status": state}
            failed.append({**shown, "reason": result.get("reason", "")})
    sizes = list(store.bytes_per_result())
    return {
        "drives": len(entries),
        **{name: states[name] for name in ("done", "failed", "set_aside", "missing")},
        "other_version": other,
        "cars": len({entry.car for entry in entries}),
        "models": len({entry.model for entry in entries}),
        "bytes_per_drive": sum(sizes) / len(sizes) if sizes else None,
        "not_done": failed,
    }
