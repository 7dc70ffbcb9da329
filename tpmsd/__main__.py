"""`python -m tpmsd` is the console command `tpmsd`."""

from tpmsd.interfaces.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
