"""Gates: which ticks and fixes are used, and whether wheels and receiver agree."""
