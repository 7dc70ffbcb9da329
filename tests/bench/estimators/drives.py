"""Short drives for the tests: pieces of the bench's route."""

from __future__ import annotations

from dataclasses import fields

from bench.worlds.paper_route import STEP_S, Route, paper_route


def piece(begin_s: float, end_s: float) -> Route:
    """The route between two instants, its clock and its wheels begun again."""
    whole = paper_route()
    first, last = round(begin_s / STEP_S), round(end_s / STEP_S) + 1
    parts = {f.name: getattr(whole, f.name)[first:last] for f in fields(Route)}
    parts["time_s"] = parts["time_s"] - parts["time_s"][0]
    parts["rolled_m"] = parts["rolled_m"] - parts["rolled_m"][0]
    return Route(**parts)


RURAL = (230.0, 400.0)
"""On the rural road, moving from the first instant on."""
