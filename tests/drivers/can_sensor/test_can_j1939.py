"""J1939: messages by their group, from one node, without the values that mean "not available"."""

from __future__ import annotations

import can
import numpy as np
import pytest

from cellwatt.channel import Quality
from cellwatt_drivers.can_sensor.listening import BusPlace, open_listening
from cellwatt_drivers.can_sensor.sensor_map import group_of

from .rig import KERNEL, running, settings

DBC = """VERSION ""

NS_ :

BS_:

BU_: NODE

BO_ 2364540158 EEC1: 8 NODE
 SG_ Speed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" NODE
 SG_ Load : 16|8@1+ (1,-125) [-125|125] "%" NODE
 SG_ Mode : 0|4@1+ (1,0) [0|15] "" NODE
"""
MAP = """maker: Acme
model: Engine
dbc: engine.dbc
streams:
  speed: {message: EEC1, signals: {Speed: engine.speed, Load: engine.load, Mode: engine.mode}}
"""
RPM = 2 * np.pi / 60
FULL, NO_SPEED, NONE = "F1FF7D6813FFFFFF", "F1FF7D01FFFFFFFF", "FFFFFEFFFEFFFFFF"


def frame(data: str, identifier: int = 0x0CF00400) -> can.Message:
    return can.Message(arbitration_id=identifier, data=bytes.fromhex(data), is_extended_id=True)


@pytest.fixture
def engine(tmp_path):
    (tmp_path / "engine.dbc").write_text(DBC)
    (tmp_path / "engine.yaml").write_text(MAP)
    return str(tmp_path / "engine.yaml")


async def test_the_first_node_that_sends_is_the_sensor(bus, engine):
    async with running(settings(KERNEL, map=engine)) as run:
        bus.put(frame(FULL), frame(FULL, 0x0CF00417), frame(FULL, 0x18F00400), frame(FULL, 0x0CF00500))
        await run.inlet.until(lambda o: o.account.received >= 2 and o.account.counters["other frames"] >= 2)
    assert run.inlet.account.received == 2, "of node 0x00, whatever the priority"
    assert run.inlet.values == pytest.approx(np.array([[621.0 * RPM, 0.0, 1.0]] * 2), rel=1e-3)


async def test_the_node_may_be_chosen(bus, engine):
    async with running(settings(KERNEL, map=engine, source_address=0x17)) as run:
        bus.put(frame(NO_SPEED), frame(FULL, 0x0CF00417))
        await run.inlet.until(lambda o: o.account.received >= 1)
    assert run.inlet.values[0, 0] == pytest.approx(621.0 * RPM, rel=1e-3)
    assert run.inlet.account.counters["other frames"] == 1


async def test_values_that_are_not_available_are_none(bus, engine):
    async with running(settings(KERNEL, map=engine)) as run:
        bus.put(frame(NO_SPEED), frame(NONE))
        await run.inlet.until(lambda o: o.account.received >= 2)
    assert run.inlet.values == pytest.approx(np.array([[np.nan, 0.0, 1.0], [np.nan] * 3]), nan_ok=True)
    quality = np.concatenate([r.quality for r in run.inlet.readings])
    assert quality.tolist() == [Quality.GOOD, Quality.MISSING]


async def test_nodes_that_the_dbc_file_names_are_told_apart(bus, engine, tmp_path):
    (tmp_path / "engine.dbc").write_text(
        DBC.replace("2364540158 EEC1", "2364539904 EEC1")
        + DBC[DBC.index("BO_") :].replace("2364540158 EEC1", "2364539927 EEC2")
        + 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
        'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\n'
    )
    (tmp_path / "engine.yaml").write_text(MAP + "  other: {message: EEC2, signals: {Speed: other.speed}}\n")
    async with running(settings(KERNEL, map=engine)) as run:
        bus.put(frame(FULL, 0x0CF00417), frame(NO_SPEED), frame(FULL, 0x0CF00418))
        await run.inlet.until(lambda o: o.account.received >= 2 and o.account.counters["other frames"])
    assert np.isnan(run.inlet.stream("speed")[0, 0])
    assert run.inlet.stream("other")[:, 0] == pytest.approx([621.0 * RPM], rel=1e-3)


@pytest.mark.parametrize(("one", "other"), [(0x18FEF100, 0x0CFEF1FE), (0x0CEF1725, 0x18EF00FE)])
def test_a_group_has_neither_priority_nor_addresses(one, other):
    assert group_of(one) == group_of(other)
    assert group_of(0x18FEF100) != group_of(0x18FEF200)


async def test_frames_of_can_fd_are_asked_of_the_kernel(monkeypatch):
    class Opened(Exception):
        pass

    def opening(**options: object) -> None:
        assert options["fd"] is True
        raise Opened

    monkeypatch.setattr(can, "Bus", opening)
    with pytest.raises(Opened):
        async with open_listening(BusPlace("socketcan", "can0")):
            pass
