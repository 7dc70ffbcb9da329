"""The ring of teeth or edges by which a wheel is counted: numbers, pitch errors and lost counts."""
