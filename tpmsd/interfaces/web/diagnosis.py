"""The diagnosis of a recorded drive for the page: made once, when asked for, by a process of its own.

In: a drive folder, a model. Out: the page of `tpmsd diagnose --html` with linked styles and scripts, and how
far it is. The process is started by `python -m tpmsd.interfaces.web.diagnosis FOLDER [MODEL]`: it writes its
progress to standard error and the page to standard output.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import TpmsdError

NICE = 10
"""Added to the process' niceness: the pages, and a daemon on the same machine, come first."""
MAX_LINE_BYTES = 1 << 20


@dataclass
class DiagnosisJob:
    """One diagnosis: not begun, under way, done or failed."""

    folder: Path
    model: Path | None = None
    """Effects that belong to the baseline; None: those of `[filter] model`."""
    page: str | None = None
    """HTML once it is done."""
    reason: str = ""
    """Reason of a failure; else empty."""
    share: float = 0.0
    """Fraction of the work that is done, 0 to 1."""
    _task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin the diagnosis unless it has begun."""
        if self._task is None:
            self._task = asyncio.create_task(self._run_process())

    def document(self) -> dict[str, Any]:
        """Return state, progress and reason of a failure, as plain JSON values."""
        begun = "waiting" if self._task is None else "running"
        state = "failed" if self.reason else begun if self.page is None else "done"
        return {"state": state, "share": self.share, "reason": self.reason or None}

    async def stop(self) -> None:
        """End the process if it runs."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    async def _run_process(self) -> None:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "tpmsd.interfaces.web.diagnosis", str(self.folder)),
            *([] if self.model is None else [str(self.model)]),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=MAX_LINE_BYTES,
            start_new_session=True,  # Ctrl-C is the server's affair
        )
        try:
            assert process.stdout is not None
            page, last = await asyncio.gather(process.stdout.read(), self._read_progress(process))
            if await process.wait() == 0:
                self.page = page.decode("utf-8")
            else:
                self.reason = last or "the diagnosis ended without a word"
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()

    async def _read_progress(self, process: asyncio.subprocess.Process) -> str:
        """Read the process's progress to its end; return the last line that is not progress."""
        last = ""
        assert process.stderr is not None
        while line := await process.stderr.readline():
            word, _, rest = line.decode("utf-8", "replace").strip().partition(" ")
            if word == "progress":
                self.share = float(rest)
            else:
                last = f"{word} {rest}".strip() or last
        return last


def main(folder: Path, model: Path | None = None) -> int:
    """Diagnose and write the page to standard output; return 0, or an exit code with a line on standard
    error."""
    os.nice(NICE)
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported
    from tpmsd.interfaces.api.functions import diagnose

    def report_progress(share: float) -> None:
        print(f"progress {share:.3f}", file=sys.stderr, flush=True)

    try:
        page = diagnose(folder, model=model, progress=report_progress).to_html(standalone=False)
    except TpmsdError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    sys.stdout.buffer.write(page.encode("utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:3])))
