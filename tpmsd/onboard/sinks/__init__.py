"""Outputs of the daemon: CAN frames, the state file, the service manager, the status socket."""
