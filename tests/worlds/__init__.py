"""Moved to `bench.worlds`; kept until everything imports it from there."""

import sys
from importlib import import_module

for _name in ("course", "folder", "instruments", "kinematic", "multibody", "road", "spec"):
    sys.modules[f"{__name__}.{_name}"] = import_module(f"bench.worlds.{_name}")
