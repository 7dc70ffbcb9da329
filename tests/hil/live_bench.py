"""`python -m bench run live` on vcan0 of a User Mode Linux guest.

    python -m tests.hil.live_bench [--seconds 15] [--json FILE]

The benchmark itself needs no guest; this runs it in one where the machine's own kernel has no vcan.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys

from bench.campaigns.onboard.live import longest_s
from tests.hil import uml
from tests.hil.prepare import BUILD, REPO
from tpmsd.interfaces.cli.output import write_json


def main() -> int:
    """Run it; its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each run")
    parser.add_argument("--json", metavar="FILE")
    args = parser.parse_args()
    reason = uml.missing()
    if reason:
        print(f"bench-live: no guest: {reason}", file=sys.stderr)
        return 1
    out, stage = BUILD / "live", BUILD / "live-stage"
    stage.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, *["-m", "bench", "run", "live", "--json=/out/live.json"]]
    command.append(f"--seconds={args.seconds:g}")
    job = f"exec >>/out/job.log 2>&1\ncd {shlex.quote(str(REPO))}\nexport OPENBLAS_NUM_THREADS=1\n"
    job += f"export PYTHONDONTWRITEBYTECODE=1\n{shlex.join(command)}\n"
    try:
        with uml.guest(job, out=out, stage=stage, build=BUILD) as guest:
            code = guest.wait(120.0 + longest_s(args.seconds))
    except uml.HilError as error:
        print(f"bench-live: {error}", file=sys.stderr)
        return 1
    print((out / "job.log").read_text("utf-8", "replace"), end="")
    if args.json is not None and code == 0:
        write_json(json.loads((out / "live.json").read_text("utf-8")), args.json)
    return code


if __name__ == "__main__":
    sys.exit(main())
