"""Drive folders without a bus: tables of signals in and out."""
