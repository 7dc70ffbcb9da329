"""Discovery of one car by Home Assistant: its MQTT discovery messages.

In: names of topics and wheels. Out: (topic, payload) pairs, to be published retained. Source:
Home Assistant's documentation, "MQTT", "Discovery payload"; one message per entity, which all versions know.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

WHEEL_NAMES = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}


def discovery(
    prefix: str, node: str, base: str, version: str, wheels: Sequence[str], name: str = "Tyres"
) -> list[tuple[str, dict[str, Any]]]:
    """Return (topic, configuration) of one message per entity; `prefix` is Home Assistant's own, `base`
    ours."""
    common: dict[str, Any] = {
        "state_topic": f"{base}/state",
        "availability_topic": f"{base}/availability",
        "device": {
            "identifiers": [f"tpmsd_{node}"],
            "name": name,
            "manufacturer": "tpmsd",
            "model": "indirect tyre pressure monitor",
            "sw_version": version,
        },
        "origin": {"name": "tpmsd", "sw_version": version},
    }
    out = []

    def add(component: str, key: str, **config: Any) -> None:
        topic = f"{prefix}/{component}/tpmsd_{node}/{key}/config"
        out.append(
            (topic, {**common, "unique_id": f"tpmsd_{node}_{key}", "object_id": f"{node}_{key}"} | config)
        )

    for wheel in wheels:
        label = WHEEL_NAMES[wheel]
        of_wheel = f"value_json.wheels.{wheel}"
        problem = f"{{{{ 'ON' if {of_wheel}.problem else 'OFF' }}}}"
        add(
            "binary_sensor",
            f"{wheel}_problem",
            name=f"Tyre {label}",
            device_class="problem",
            value_template=problem,
        )
        add(
            "sensor",
            f"{wheel}_deviation",
            name=f"Radius deviation {label}",
            value_template=f"{{{{ {of_wheel}.deviation_mm }}}}",
            unit_of_measurement="mm",
            device_class="distance",
            state_class="measurement",
            suggested_display_precision=1,
            entity_category="diagnostic",
        )
        add(
            "sensor",
            f"{wheel}_pressure_loss",
            name=f"Pressure loss {label}",
            value_template=f"{{{{ {of_wheel}.pressure_loss_percent }}}}",
            unit_of_measurement="%",
            state_class="measurement",
            suggested_display_precision=0,
        )
    add(
        "binary_sensor",
        "malfunction",
        name="Malfunction",
        device_class="problem",
        value_template="{{ 'ON' if value_json.malfunction else 'OFF' }}",
        entity_category="diagnostic",
    )
    add(
        "sensor",
        "health",
        name="Health",
        value_template="{{ value_json.health }}",
        entity_category="diagnostic",
    )
    return out
