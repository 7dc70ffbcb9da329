"""Counters that miscount, looked for apart from the windows of a second."""
