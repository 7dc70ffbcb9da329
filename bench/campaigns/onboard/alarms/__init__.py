"""Alarms on drives of a world of its own: regulation scenarios, confounders, false alarms per kilometre."""
