from __future__ import annotations

import json
import re

import pytest

from cellwatt.config import json_schema


@pytest.fixture
def schema():
    return json.loads(json.dumps(json_schema()))


def source_choice(schema, driver):
    return schema["$defs"][f"driver_{driver}"]


def test_every_driver_with_its_settings_and_docs(schema):
    arm = source_choice(schema, "arm")
    assert set(arm["required"]) == {"driver", "host"}
    assert arm["properties"]["host"]["description"].startswith("Address of the controller")
    assert arm["properties"]["client"]["enum"] == ["native", "library"]
    assert arm["additionalProperties"] is False
    sources = schema["properties"]["sources"]["additionalProperties"]
    assert list(sources["discriminator"]["mapping"]) == ["absent", "arm", "broken", "meter"]
    assert source_choice(schema, "absent")["description"].startswith("cannot be loaded")


def test_a_name_that_the_cell_would_refuse_is_flagged(schema):
    for named in (schema["properties"]["sources"], schema["$defs"]["Stages"]):
        assert not re.search(named["propertyNames"]["pattern"], "Arm 1")
        assert re.search(named["propertyNames"]["pattern"], "arm_1")


def test_defaults_are_as_written(schema):
    assert source_choice(schema, "arm")["properties"]["rate"]["default"] == "500 Hz"
    assert schema["$defs"]["RecordSettings"]["properties"]["keep"]["default"] == "20 GB"
    assert schema["$defs"]["FrameSettings"]["properties"]["latency"]["default"] == "100 ms"
    assert source_choice(schema, "arm")["properties"]["payload"]["default"] == 0.0
