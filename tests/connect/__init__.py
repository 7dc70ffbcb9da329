"""Against real servers: `make test-connect`."""
