"""The node of docs/how-to/ros2.md reads what the bridge publishes; ROS and the broker have stand-ins."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from tests.interfaces.bridges.documents import alarm, document
from tpmsd.interfaces.bridges.mqtt_messages import Announcer, Topics
from tpmsd.interfaces.bridges.summary import summarise

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "ros2.md"


class Status(SimpleNamespace):
    """Stand-in for `diagnostic_msgs.msg.DiagnosticStatus`."""

    OK, ERROR = b"\x00", b"\x02"


def test_the_node_of_the_page_reports_the_soft_tyre(monkeypatch: pytest.MonkeyPatch) -> None:
    """It subscribes to the topic of the state, and the wheel with an alarm alone is an error."""
    names = "rclpy", "paho", "paho.mqtt", "paho.mqtt.client", "diagnostic_msgs", "diagnostic_msgs.msg"
    stand_ins = {name: MagicMock() for name in names}
    for name, module in stand_ins.items():
        monkeypatch.setitem(sys.modules, name, module)
    messages = stand_ins["diagnostic_msgs.msg"]
    messages.DiagnosticArray = lambda: SimpleNamespace(header=SimpleNamespace(), status=[])
    messages.DiagnosticStatus, messages.KeyValue = Status, SimpleNamespace
    found = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert found is not None
    node: dict[str, Any] = {}
    exec(found[1], node)
    announcer = Announcer(Topics("tpmsd/car"), 10.0)
    announcer.recall(None)
    state = announcer.state(summarise(document(alarm())), 0.0)[0]

    node["client"].on_connect(node["client"], None)
    node["publish"](node["client"], None, state)

    node["client"].subscribe.assert_called_once_with(state.topic)
    (array,) = node["publisher"].publish.call_args.args
    levels = {status.name: status.level for status in array.status}
    assert levels.pop("tyre rl") == Status.ERROR
    assert {Status.OK} == set(levels.values())
    assert "deviation_mm" in {value.key for value in array.status[0].values}
