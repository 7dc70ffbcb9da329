"""A page for the running daemon and for recorded drives: `tpmsd web`, a process of its own (extra `web`)."""
