"""Home Assistant core's own schema against the discovery messages.

Home Assistant brings a hundred packages in versions of its own, so it lives in an environment of its own:

    python3.11 -m venv ha && ha/bin/pip install 'homeassistant==2024.3.3' 'paho-mqtt==1.6.1'
    TPMSD_HOME_ASSISTANT=ha/bin/python make test-connect
"""

from __future__ import annotations

import json
import os
import subprocess

import pytest

from tpmsd.interfaces.bridges.home_assistant import discovery

CHECK = """
import json, sys
from homeassistant.components.mqtt import binary_sensor, sensor
schemas = {"binary_sensor": binary_sensor.DISCOVERY_SCHEMA, "sensor": sensor.DISCOVERY_SCHEMA}
for topic, config in json.load(sys.stdin):
    try:
        schemas[topic.split("/")[1]](config)
        print("accepted")
    except Exception as error:
        print("refused:", error)
"""


def test_home_assistant_core_accepts_the_discovery() -> None:
    """Every message passes the schema that Home Assistant itself applies; one that is bent does not."""
    python = os.environ.get("TPMSD_HOME_ASSISTANT")
    if not python:
        pytest.skip("TPMSD_HOME_ASSISTANT names no Python with Home Assistant")
    messages = discovery("homeassistant", "car", "tpmsd/car", "9.9", ("fl", "fr", "rl", "rr"))
    bent = (messages[0][0], messages[0][1] | {"device_class": "flat"})
    done = subprocess.run(
        [python, "-c", CHECK], input=json.dumps([*messages, bent]), capture_output=True, text=True, check=True
    )
    *said, last = done.stdout.splitlines()

    assert ["accepted"] * 14 == said
    assert last.startswith("refused:")
