"""What is counted shows in the status."""

from __future__ import annotations

import logging
from pathlib import Path

from tests.daemon.fakes import FakeBus, car
from tests.gnss.sentences import nmea
from tpmsd.daemon.bus_link import BusLink
from tpmsd.daemon.health import GNSS_FAULTS, Health
from tpmsd.daemon.input_queue import InputQueue
from tpmsd.daemon.receiver_link import ReceiverLink, configured_receiver
from tpmsd.pipeline import Pipeline
from tpmsd.sources.nmea_epoch import NmeaAssembler
from tpmsd.sources.nmea_sentence import HANDLED

LOG = logging.getLogger("tests.health")


def test_every_fault_of_the_receiver_has_its_place_in_the_status() -> None:
    """Whatever kind of fault the sentences' assembler counts, the status has it."""
    told = set(NmeaAssembler().counts) - HANDLED - {"fixes", "ignored", "no_checksum"}
    assert told == set(GNSS_FAULTS)


def test_counts_of_all_stages_are_in_the_document(tmp_path: Path) -> None:
    """Faults of decoding, of the time line and of the links stand side by side."""
    config, database = car(tmp_path, '[gnss]\ndevice = "none"\n')
    bus = FakeBus()
    bus_link = BusLink(lambda: bus.opener()(config.can, None, "fake"), "CAN fake", LOG)
    receiver = ReceiverLink(configured_receiver(config.gnss), "receiver none", LOG)
    receiver.service(0.0)
    pipeline = Pipeline(config, database)
    pipeline.on_frame(1000.0, 0xB0, False, b"\x01")
    pipeline.on_sentence(1000.1, b"$GPGGA,garbage*00")
    for kind in ("late_fixes", "early_fixes", "implausible"):
        pipeline.timeline.counts[kind] = 3
    pipeline.on_sentence(1000.2, nmea("GPRMC,080000,V,,,,,,,010724,,,N"))
    pipeline.on_sentence(1001.2, nmea("GPRMC,080001,V,,,,,,,010724,,,N"))

    document = Health(config, bus_link, receiver, InputQueue(), 0.0).document(pipeline, 1.0, 0)

    assert {"short": 4, "implausible": 3} == document["can"]["faults"]
    assert {"checksum": 1, "no_fix": 1, "unplugged": 1, "late": 3, "early": 3} == document["gnss"]["faults"]
