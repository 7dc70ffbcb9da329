"""tpmsd@.service, one daemon per interface: bound to the interface and, where wanted, to the receiver.

The interface is made by the example for systemd-networkd, the receiver gets its name from the example for
udev (a serial line of this machine stands in for the USB device).
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.hil.guest.rig import ask, run, wait_until
from tests.hil.guest.service.conftest import CONFIG, Car
from tests.hil.guest.service.manager import UNITS, drop_in, messages, show, systemctl

EXAMPLES = Path("/usr/share/doc/tpmsd/examples")
UNIT = "tpmsd@vcan1.service"
SOCKET = "/run/tpmsd-vcan1/status.sock"
RECEIVER = Path("/dev/tpmsd-gnss")
DEVICE = r"dev-tpmsd\x2dgnss.device"
TTY = "ttyS7"


@pytest.fixture(scope="module", autouse=True)
def prepared(machine: Car) -> None:
    """A configuration for vcan1; networkd's and udev's examples in place under that name."""
    config = CONFIG.with_name("vcan1.toml")
    config.write_text(CONFIG.read_text().replace("/run/gnss", str(RECEIVER)))
    config.chmod(0o644)
    for file in (EXAMPLES / "network").glob("80-vcan0.*"):
        target = Path("/etc/systemd/network") / file.name.replace("vcan0", "vcan1")
        target.write_text(file.read_text().replace("vcan0", "vcan1"))
    (rule,) = (EXAMPLES / "udev").glob("*.rules")
    text, found = re.subn(r'KERNEL=="[^"]*", ATTRS\{[^,]*, ', f'KERNEL=="{TTY}", ', rule.read_text())
    assert found == 1
    Path("/etc/udev/rules.d", rule.name).write_text(text)
    run("udevadm", "control", "--reload")


def link_state(channel: str) -> str:
    done = subprocess.run(["ip", "-d", "link", "show", channel], capture_output=True, text=True)
    return done.stdout


def test_the_networkd_example_makes_the_bus() -> None:
    """systemd-networkd makes the interface, with room for CAN FD, and sets it up."""
    systemctl("start", "systemd-networkd.service")
    wait_until(lambda: "UP" in link_state("vcan1"), "the interface is up")

    assert "mtu 72" in link_state("vcan1")
    assert "vcan " in link_state("vcan1")


def test_the_udev_example_names_the_receiver() -> None:
    """Whichever port it is on: one name, for the group of serial lines, and a device unit."""
    run("udevadm", "trigger", "--action=add", f"/sys/class/tty/{TTY}")
    wait_until(RECEIVER.exists, "the receiver has its name")
    device = RECEIVER.stat()

    assert TTY == RECEIVER.resolve().name
    assert 0o660 == device.st_mode & 0o777
    assert "dialout" == RECEIVER.group()
    wait_until(lambda: "active" == show(DEVICE, "ActiveState"), "it has a device unit")


def test_the_instance_runs_on_its_interface() -> None:
    """Started for vcan1: reads its own file, keeps state and socket apart from the others'."""
    systemctl("enable", "--now", UNIT)
    document = ask(SOCKET)

    assert ("vcan1", str(RECEIVER)) == (document["can"]["channel"], document["gnss"]["device"])
    assert document["ticks"] > 0
    assert Path("/var/lib/private/tpmsd-vcan1").is_dir()


def test_it_goes_with_its_interface_and_comes_back_with_it() -> None:
    """Deleted: stopped in order. Made again: started again, without anybody's help."""
    run("ip", "link", "del", "vcan1")
    wait_until(lambda: "inactive" == show(UNIT, "ActiveState"), "it stops with the interface")
    assert "success" == show(UNIT, "Result")

    run("ip", "link", "add", "dev", "vcan1", "type", "vcan")
    wait_until(lambda: "active" == show(UNIT, "ActiveState"), "it starts with the interface")
    wait_until(lambda: ask(SOCKET).get("ticks", 0) > 0, "first tick")


def test_with_the_example_it_is_bound_to_the_receiver_too() -> None:
    """Without the drop-in an unplugged receiver stops nothing; with it the daemon stops."""
    assert "dev-tpmsd" not in show(UNIT, "BindsTo")
    text = (EXAMPLES / "tpmsd@.service.d" / "receiver.conf").read_text()
    drop_in("tpmsd@.service", text, "receiver")
    systemctl("restart", UNIT)
    assert "dev-tpmsd" in show(UNIT, "BindsTo")
    run("udevadm", "trigger", "--action=remove", f"/sys/class/tty/{TTY}")
    wait_until(lambda: "active" != show(UNIT, "ActiveState"), "it stops with the receiver")

    assert any("stopping: SIGTERM" in line for line in messages(UNIT))


def test_the_package_takes_everything_away(machine: Car) -> None:
    """What the package does on removal and purge: instances stopped, compiled modules and state gone."""
    shutil.rmtree(UNITS / "tpmsd@.service.d")
    systemctl("daemon-reload")
    run("udevadm", "trigger", "--action=add", f"/sys/class/tty/{TTY}")
    systemctl("start", UNIT)
    scripts = Path("/var/lib/dpkg/info")
    run("sh", scripts / "tpmsd.prerm", "remove")
    assert "inactive" == show(UNIT, "ActiveState")
    assert [] == list(Path("/usr/lib/tpmsd/lib").rglob("__pycache__"))

    assert [] != list(Path("/var/lib/private").glob("tpmsd*"))
    run("sh", scripts / "tpmsd.postrm", "purge")
    assert [] == [*Path("/var/lib/private").glob("tpmsd*"), *Path("/var/lib").glob("tpmsd*")]
