"""The program on another processor, by emulation: `make test-qemu`."""
