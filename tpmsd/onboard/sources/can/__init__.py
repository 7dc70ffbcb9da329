"""CAN frames: live or from a log, who sends them, and what their signals say."""
