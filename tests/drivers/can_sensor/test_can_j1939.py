"""J1939: messages by their group, from one node, without the values that mean "not available"."""

from __future__ import annotations

import can
import numpy as np
import pytest

from cellwatt.channel import Quality
from cellwatt.errors import ConfigError
from cellwatt_drivers.can_sensor import CanSensorDriver

from ..inlet import CollectingInlet
from .rig import KERNEL, running, settings

MESSAGE = """BO_ {} {}: 8 NODE
 SG_ Speed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" NODE
 SG_ Load : 16|8@1+ (-1,125) [-125|125] "%" NODE
 SG_ Mode : 0|4@1+ (1,0) [0|15] "" NODE
"""
FORMATS = 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
J1939 = FORMATS + 'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
EXTENDED = FORMATS + 'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";\nBA_ "VFrameFormat" BO_ {} 1;\n'
RPM = 2 * np.pi / 60
FULL, NO_SPEED, NONE = "F1FF7D6813FFFFFF", "F1FF7D01FFFFFFFF", "FFFFFEFFFEFFFFFF"


def frame(data: str, identifier: int = 0x0CF00400) -> can.Message:
    return can.Message(arbitration_id=identifier, data=bytes.fromhex(data), is_extended_id=True)


@pytest.fixture
def engine(tmp_path):
    """Writes a map of messages with these identifiers."""

    def made(*identifiers: int, more: str = "") -> str:
        identifiers = identifiers or (0x0CF004FE,)
        messages = [MESSAGE.format(0x8000_0000 | number, f"M{i}") for i, number in enumerate(identifiers)]
        (tmp_path / "engine.dbc").write_text('VERSION ""\nNS_ :\nBS_:\nBU_: NODE\n' + "".join(messages) + more)
        signals = "{{message: M{0}, signals: {{Speed: m{0}.speed, Load: m{0}.load, Mode: m{0}.mode}}}}"
        streams = [f"  m{i}: {signals.format(i)}\n" for i in range(len(identifiers))]
        (tmp_path / "engine.yaml").write_text(f"maker: A\nmodel: E\ndbc: engine.dbc\nstreams:\n{''.join(streams)}")
        return str(tmp_path / "engine.yaml")

    return made


A_NODE, ANOTHER, URGENT, OTHER_GROUP = 0x0CF00400, 0x0CF00417, 0x18F00400, 0x0CF00500


@pytest.mark.parametrize(
    ("declared", "more", "wanted", "own"),
    [
        ([0x0CF004FE], "", {}, [A_NODE, URGENT]),  # the first that sends, whatever the priority
        ([0x0CF004FE], "", {"source_address": 0x17}, [ANOTHER]),
        ([0x0CF00417, 0x0CF00418], J1939, {}, [ANOTHER]),
        ([0x18EF17FE, 0x0CF004FE], "", {}, [A_NODE, URGENT, 0x0CEF1700]),
        ([0x18EFFFFE], "", {}, [0x0CEF1700, 0x0CEF2500]),
        ([0x0CF004FE, 0x0CF00417], "", {}, [A_NODE, URGENT, ANOTHER]),  # the second is not J1939's
        ([0x0CF004FE, ANOTHER], EXTENDED.format(0x8CF004FE), {}, [ANOTHER]),  # nor is the first
    ],
)
async def test_frames_are_the_sensors_by_group_node_and_destination(bus, engine, declared, more, wanted, own):
    sent = [A_NODE, ANOTHER, URGENT, OTHER_GROUP, 0x0CEF1700, 0x0CEF2500]
    async with running(settings(KERNEL, map=engine(*declared, more=more), **wanted)) as run:
        bus.put(*(frame(FULL, number) for number in sent))
        await run.inlet.until(lambda o: o.account.received + o.account.counters["other frames"] >= len(sent))
    assert run.inlet.account.received == len(own)
    assert run.inlet.values == pytest.approx(np.array([[621.0 * RPM, 0.0, 1.0]] * len(own)), rel=1e-3)


async def test_values_that_are_not_available_are_none(bus, engine):
    async with running(settings(KERNEL, map=engine())) as run:
        bus.put(frame(NO_SPEED), frame(NONE))
        await run.inlet.until(lambda o: o.account.received >= 2)
    assert run.inlet.values == pytest.approx(np.array([[np.nan, 0.0, 1.0], [np.nan] * 3]), nan_ok=True)
    quality = np.concatenate([r.quality for r in run.inlet.readings])
    assert quality.tolist() == [Quality.GOOD, Quality.MISSING]


def test_a_source_address_without_j1939_is_refused(engine):
    with pytest.raises(ConfigError, match="source_address: the DBC file of E declares no message as J1939"):
        CanSensorDriver("e", settings(KERNEL, map=engine(0x0CF00417), source_address=0x17), CollectingInlet())
