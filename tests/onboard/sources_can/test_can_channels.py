"""Logs of several buses: the configured one is taken where it can be told."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from tests.faults.drives import drive
from tpmsd.interfaces.cli.drive_reading import open_drive
from tpmsd.interfaces.cli.replay import replay
from tpmsd.onboard.sources.can.block import FrameBlock, block_of
from tpmsd.onboard.sources.can.channels import Channel, choose_channel
from tpmsd.onboard.sources.can.frame import CanFrame


def block(*channels: str, number: int = 0xB0) -> list[FrameBlock]:
    return [block_of([CanFrame(0.0, name, number, False, False, False, False, b"") for name in channels])]


def test_the_configured_channel_is_taken_where_two_share_identifiers() -> None:
    """Of two buses with the wheels' identifier the configured one is the car's."""
    assert Channel("can1") == choose_channel(block("can0", "can1", "can1"), {0xB0}, "can1")


def test_a_channel_by_number_is_found() -> None:
    """ASC and BLF call channels 0 and 1: the number of the configured name counts."""
    assert Channel("1") == choose_channel(block("0", "0", "1"), {0xB0}, "can1")


def test_one_channel_is_taken_whatever_its_name() -> None:
    """A log of one bus, recorded under another name, is taken whole; so is one whose other bus is foreign."""
    assert Channel(None) == choose_channel(block("vcan3"), {0xB0}, "can0")
    both = [*block("can1"), *block("can0", number=0x123)]
    assert Channel(None) == choose_channel(both, {0xB0}, "can0")


def test_where_none_is_the_configured_one_that_is_said() -> None:
    """The channel with most of the needed frames is taken, and one line names them all."""
    chosen = choose_channel(block("a", "b", "b"), {0xB0}, "can0")

    assert "b" == chosen.name
    assert chosen.note == (
        "a and b all carry identifiers that are needed, and none is the configured can0; b is taken"
    )


def test_a_second_bus_with_the_same_identifiers_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A log of two cars' buses replays as that of the configured one alone, whatever the other says."""
    config, _ = drive()
    folder = config.can.dbc.parent
    for name in ("vehicle.toml", "bus.dbc", "gnss.nmea"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    lines = (folder / "can.log").read_text("ascii").splitlines()[:6000]
    other = [line.replace("can0", "can1")[:-8] + "00000000" for line in lines]
    both = [text for pair in zip(lines, other, strict=True) for text in pair]
    (tmp_path / "can.log").write_text("\n".join(both) + "\n", "ascii")

    opened, _ = open_drive(tmp_path, config)
    assert "can0" == opened.channel
    first = replay(tmp_path, config)
    (tmp_path / "can.log").write_text("\n".join(lines) + "\n", "ascii")
    alone = replay(tmp_path, config)
    assert [w.deviation_m for w in alone.wheels] == [w.deviation_m for w in first.wheels]
    assert "" == capsys.readouterr().err

    (tmp_path / "can.log").write_text("\n".join(both) + "\n", "ascii")
    elsewhere = dataclasses.replace(config, can=dataclasses.replace(config.can, channel="can7"))
    open_drive(tmp_path, elsewhere)
    assert "none is the configured can7" in capsys.readouterr().err
