"""`python -m tpmsd` is the console command `tpmsd`."""

from tpmsd.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
