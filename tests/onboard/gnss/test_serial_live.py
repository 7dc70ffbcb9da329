from __future__ import annotations

import os
import select
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.onboard.gnss.sentences import rmc
from tpmsd.foundation.errors import TpmsdError
from tpmsd.onboard.sources.gnss.nmea_framer import NmeaFramer
from tpmsd.onboard.sources.gnss.serial_live import ReceiverGone, SerialReceiver

T = 1720716104.0


class Pty:
    """A pseudo terminal: the receiver's end, and the name of the computer's end."""

    def __init__(self) -> None:
        self.receiver, self._computer = os.openpty()
        tty.setraw(self._computer)
        self.name = os.ttyname(self._computer)

    def unplug(self) -> None:
        if self.receiver >= 0:
            os.close(self.receiver)
            os.close(self._computer)
            self.receiver = -1


@pytest.fixture
def pty() -> Iterator[Pty]:
    pty = Pty()
    yield pty
    pty.unplug()


def ready(receiver: SerialReceiver) -> bool:
    return bool(select.select([receiver.fileno()], [], [], 2.0)[0])


def test_bytes_arrive(pty: Pty):
    """What the receiver sends is read, and its descriptor becomes ready when there is something."""
    framer = NmeaFramer()
    with SerialReceiver(pty.name) as receiver:
        os.write(pty.receiver, rmc(T) + b"\r\n" + rmc(T + 1)[:10])
        assert ready(receiver)
        assert [rmc(T)] == framer.feed(receiver.read())
        os.write(pty.receiver, rmc(T + 1)[10:] + b"\r\n")
        assert ready(receiver)
        assert [rmc(T + 1)] == framer.feed(receiver.read())


def test_read_never_waits(pty: Pty):
    """With nothing at hand a read is empty at once."""
    with SerialReceiver(pty.name) as receiver:
        assert b"" == receiver.read()


def test_unplugged(pty: Pty):
    """A receiver that is unplugged is gone at the next read, with one line that says so."""
    with SerialReceiver(pty.name) as receiver:
        pty.unplug()
        assert ready(receiver)
        with pytest.raises(ReceiverGone, match=f"^{pty.name}: unplugged, or its driver has failed$"):
            receiver.read()


def test_plugged_in_again(tmp_path: Path):
    """After it went away, the same receiver object opens the device again and reads on."""
    device = tmp_path / "ttyACM0"
    first = Pty()
    device.symlink_to(first.name)
    receiver = SerialReceiver(str(device))
    receiver.open()
    first.unplug()
    with pytest.raises(ReceiverGone):
        receiver.read()
    receiver.close()
    device.unlink()
    with pytest.raises(ReceiverGone, match="no such device"):
        receiver.open()
    second = Pty()
    device.symlink_to(second.name)
    receiver.open()
    os.write(second.receiver, b"$GNRMC")
    assert ready(receiver)
    assert b"$GNRMC" == receiver.read()
    receiver.close()
    second.unplug()


def test_closed_receiver(pty: Pty):
    """Reading a closed receiver is an error of the same kind; closing twice is none."""
    receiver = SerialReceiver(pty.name)
    for action in (receiver.read, receiver.fileno):
        with pytest.raises(ReceiverGone, match="not open"):
            action()
    receiver.open()
    assert receiver.is_open
    receiver.close()
    receiver.close()
    assert not receiver.is_open


def test_missing_device(tmp_path: Path):
    """A device that is not there is one line with its name."""
    path = str(tmp_path / "ttyUSB9")
    with pytest.raises(ReceiverGone) as caught:
        SerialReceiver(path).open()
    assert f"{path}: no such device" == str(caught.value)
    assert isinstance(caught.value, OSError)
    assert isinstance(caught.value, TpmsdError)


def test_no_serial_device(tmp_path: Path):
    """A plain file is named as no serial device."""
    path = tmp_path / "file"
    path.touch()
    with pytest.raises(ReceiverGone, match="not a serial device"):
        SerialReceiver(str(path)).open()


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may open everything")
def test_no_permission(tmp_path: Path):
    """A device that may not be opened says which group helps."""
    path = tmp_path / "tty"
    path.touch(mode=0)
    with pytest.raises(ReceiverGone, match=r"no permission .*dialout"):
        SerialReceiver(str(path)).open()


def test_two_readers(pty: Pty):
    """A second program on the same line is refused."""
    with SerialReceiver(pty.name), pytest.raises(ReceiverGone, match="in use by another program"):
        SerialReceiver(pty.name).open()


@pytest.mark.parametrize("baud", [0, -9600])
def test_impossible_baud_rate(pty: Pty, baud: int):
    """A baud rate of nothing is refused in one line."""
    with pytest.raises(ReceiverGone, match=f"baud rate {baud} is no positive whole number"):
        SerialReceiver(pty.name, baud).open()


def test_baud_rate_beyond_the_device(pty: Pty):
    """A baud rate that the device cannot have is refused in one line."""
    with pytest.raises(ReceiverGone, match="baud rate 99999999999"):
        SerialReceiver(pty.name, 99999999999).open()
