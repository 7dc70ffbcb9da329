"""The car library: one TOML file per platform, data alone (docs/how-to/cars.md)."""
