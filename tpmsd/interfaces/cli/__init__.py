"""The command line: one module per command, `main` that picks one, `output` that they share."""
