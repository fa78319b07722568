"""The page about MQTT says what is so."""

from __future__ import annotations

import re

from cellwatt import AlarmBook, Energy, Event, Interval, Task
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.selection import Row
from tests.daemon.outlets.mqtt.cell import alarm
from tests.docs.pages import ROOT

PAGE = "outlets/mqtt.md"
TEXT = (ROOT / "docs" / PAGE).read_text()


def test_the_table_of_topics_has_all_and_says_which_are_kept() -> None:
    kept: dict[str, bool] = {}
    format_ = PlainFormat(MqttSettings(), "SITE", "CELL", AlarmBook())
    row = Row(1, 2, {"CHANNEL": 1.0}, {"CHANNEL": 0})
    told = [format_.connect(), *format_.birth(0), *format_.label({"CHANNEL": "W"}, 0)]
    told += [*format_.row(row, False, 0), *format_.row(row, True, 0), *format_.predicted("MODEL", {}, row, 0)]
    task, energy = (
        Task("a", "t", "s", "v", 1.0, 1, 2, (), 1),
        Energy("a", "t", "v", 1, 1, 2, 3.0, {}, 0.1, 1.0, 2.0),
    )
    told += [*format_.health({}, 0), *format_.result(task, False, 0), *format_.result(energy, False, 0)]
    told += [message for result in (task, energy, alarm(1)) for message in format_.archived(result, 0)]
    told += format_.result(Interval("a", 1, 1, 2, (), (), (), ()), False, 0)
    told += [*format_.result(Event(1, None, "k", "t"), False, 0), *format_.result(alarm(1), False, 0)]
    for message in told:
        kept[message.topic.removeprefix("cellwatt/SITE/CELL/")] = message.retain
    kept["alarm/SEVERITY/KIND/ID"] = kept.pop("alarm/error/joint_fault/faults.arm.1")
    section = TEXT[TEXT.index("## Topics") : TEXT.index("## Ignition")]
    rows = re.findall(r"^\| (`.*?) \| .* \| (.*?) \|$", section, re.MULTILINE)
    said = {
        topic: "yes" in keeps or "until" in keeps for names, keeps in rows for topic in re.findall(r"`(.*?)`", names)
    }
    assert said == kept
