"""Files that a command writes: checked first, whole or not at all, one failure not in the way of another."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tpmsd.interfaces.cli.output_files import OutputError, Outputs, write_whole


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("nowhere/a.json", "--json {}: there is no folder "),
        ("", "--json {}: a folder; the name of a file is wanted"),
        ("file/a.json", "--json {}: there is no folder "),
    ],
)
def test_a_target_that_cannot_be_is_refused_before_the_work(tmp_path: Path, target: str, reason: str) -> None:
    """The line names the option, the target and the reason."""
    (tmp_path / "file").write_text("")
    path = tmp_path / target
    with pytest.raises(OutputError) as caught:
        Outputs(("--json", path), ("--html", None))
    assert str(caught.value).startswith(reason.format(path))
    assert 1 == caught.value.exit_code


def test_two_outputs_do_not_share_a_file(tmp_path: Path) -> None:
    """The second would replace the first."""
    with pytest.raises(OutputError, match="--json goes there already"):
        Outputs(("--json", tmp_path / "a"), ("--html", tmp_path / "." / "a"))


def test_one_failure_does_not_keep_the_others_from_being_written(tmp_path: Path) -> None:
    """A full disk under one file (Linux has a device for that) leaves the rest, and one line."""
    outputs = Outputs(("--html", "/dev/full"), ("--json", tmp_path / "a.json"))
    with pytest.raises(OutputError, match=r"^/dev/full: cannot be written: No space left on device$"):
        outputs.write({"--html": lambda: "page" * 5000, "--json": lambda: "{}"})
    assert "{}" == (tmp_path / "a.json").read_text()


def test_what_fails_half_way_leaves_the_old_file_and_nothing_beside_it(tmp_path: Path) -> None:
    """A file larger than allowed is the closest thing to a full disk that a process can give itself."""
    import resource
    import signal

    target = tmp_path / "a.json"
    target.write_text("old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OutputError, match="cannot be written: File too large"):
            write_whole(target, "x" * 5000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)
    assert {"a.json": "old"} == {path.name: path.read_text() for path in tmp_path.iterdir()}


def test_a_link_stays_one_and_keeps_its_targets_mode(tmp_path: Path) -> None:
    """The file behind the link is replaced, with the permissions it had."""
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("old")
    real.chmod(0o600)
    link.symlink_to(real)
    write_whole(link, "new", backup=True)
    assert (True, "new", "old") == (link.is_symlink(), real.read_text(), (tmp_path / "real.bak").read_text())
    assert 0o600 == real.stat().st_mode & 0o777


def test_a_pipe_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    """`--json >(jq .)` and the like are no regular files."""
    reader, writer = os.pipe()
    write_whole(Path(f"/dev/fd/{writer}"), b"through")
    os.close(writer)
    assert b"through" == os.read(reader, 100)
    os.close(reader)


def test_a_reader_that_has_gone_does_not_keep_files_from_being_written(tmp_path: Path) -> None:
    """Standard output is a pipe that nobody reads any more, as after `| head`: the file is whole."""
    code = (
        "import sys\nfrom tpmsd.interfaces.cli.output_files import Outputs\n"
        "outputs = Outputs(('--json', sys.argv[1]))\noutputs.say('report')\n"
        "outputs.write({'--json': lambda: '{}'})\n"
    )
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "a.json")], stdout=writer, check=False, timeout=60
        )
    finally:
        os.close(writer)
    assert 0 == ended.returncode
    assert "{}" == (tmp_path / "a.json").read_text()
