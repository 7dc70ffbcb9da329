"""The DBCs of a car: one for each bus.

In: paths, a configuration. Out: cantools' databases.
"""

from __future__ import annotations

from pathlib import Path

from cantools.database.can import Database

from tpmsd.car.config.dbc import load_dbc
from tpmsd.car.config.model import Config


class CarDatabase(Database):
    """The DBC of [can], with those of the further buses."""

    others: tuple[Database, ...] = ()
    """Databases in the order of [can.buses]."""


def load_databases(config: Config) -> Database:
    """Return the DBCs of all buses of a configuration; `ConfigError` as `load_database`."""
    main = load_database(config.can.dbc)
    if not config.can.buses:
        return main
    car = CarDatabase(main.messages, strict=False)
    loaded = {config.can.dbc: main}
    for bus in config.can.buses.values():
        if bus.dbc not in loaded:
            loaded[bus.dbc] = load_database(bus.dbc)
    car.others = tuple(loaded[bus.dbc] for bus in config.can.buses.values())
    return car


def database_of(database: Database, bus: int) -> Database:
    """Return the database of a bus by its number; the one of [can] where there is but one."""
    others = database.others if isinstance(database, CarDatabase) else ()
    return others[bus - 1] if 0 < bus <= len(others) else database


def load_database(path: str | Path) -> Database:
    """Read a DBC (or KCD, SYM, ARXML) file; raises a `ConfigError` of one line that says what is wrong with
    it."""
    return load_dbc(Path(path))
