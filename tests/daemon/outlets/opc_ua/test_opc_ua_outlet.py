"""The cell over OPC UA: values, units, alarms as conditions, and who comes in."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asyncua import Client, ua
from asyncua.common.utils import Buffer, NotEnoughData
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.ua import ua_binary

from cellwatt.channel import Quality
from cellwatt.frames import Frames
from cellwatt.outlets.opc_ua.arrays import ENTRIES, READERS, bound_arrays
from cellwatt.outlets.opc_ua.bounds import SUBSCRIPTIONS_OF_SESSION
from cellwatt.outlets.opc_ua.outlet import OpcUaOutlet, OpcUaOutletSettings
from cellwatt.results import Energy, Event
from cellwatt_drivers.opc_ua import OpcUaDriver, OpcUaSettings
from tests.blocks import frames_of, layout_of
from tests.daemon.outlets.page.cell import View
from tests.daemon.outlets.serving import children, serving
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, alarm
from tests.drivers.inlet import CollectingInlet
from tests.drivers.opc_ua.rig import certificate
from tests.drivers.running import repeated
from tests.patience import eventually

JOINT = {"position": "rad", "velocity": "rad/s", "current": "A", "temperature": "degC"}
LAYOUT = layout_of({**{f"arm.joint_1.{name}": unit for name, unit in JOINT.items()}, "mains.supply.power": "W"})
ACKNOWLEDGE = ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge)
LIMITS = {
    "OperationLimits_MaxNodesPerRead": ENTRIES,
    "OperationLimits_MaxNodesPerBrowse": ENTRIES,
    "MaxSubscriptionsPerSession": SUBSCRIPTIONS_OF_SESSION,
}
OWN = f"urn:cellwatt:{SITE}:{CELL}"
VALUES = [0.5, -0.25, 2.5, 41.0, 600.0]


def frames(number: int, values: list[float] = VALUES, quality: Quality = Quality.GOOD) -> Frames:
    return frames_of(LAYOUT, number, [EPOCH + number * LAYOUT.step], np.array([values]), quality)


@asynccontextmanager
async def a_cell(**settings: Any) -> AsyncIterator[OpcUaOutlet]:
    """An outlet that serves, at 50 rows a second."""
    given = {"listen": "127.0.0.1:0", "rate": "50 Hz"} | settings
    outlet = OpcUaOutlet("opc_ua", OpcUaOutletSettings.model_validate(given), View(Path("/")))
    async with serving(outlet):
        yield outlet


@asynccontextmanager
async def client(outlet: OpcUaOutlet, user: str = "", password: str = "") -> AsyncIterator[Client]:
    made = Client(outlet.url)
    if user:
        made.set_user(user)
        made.set_password(password)
    async with made:
        yield made


async def value(there: Client, name: str) -> ua.DataValue:
    space = await there.get_namespace_index(OWN)
    return await there.get_node(ua.NodeId(name, space)).read_data_value(raise_on_bad_status=False)


async def unit_of(there: Client, name: str) -> ua.EUInformation:
    node = there.get_node(ua.NodeId(name, await there.get_namespace_index(OWN)))
    return await (await node.get_child("0:EngineeringUnits")).read_value()


async def has_value(there: Client, name: str) -> ua.DataValue:
    async def found() -> ua.DataValue | None:
        with suppress(ua.UaStatusCodeError):
            now = await value(there, name)
            return now if now.Value is not None and now.Value.Value is not None else None
        return None

    return await eventually(found, f"a value of {name}")


async def test_a_cell_without_users():
    """One server for all, as it takes seconds to start."""
    async with a_cell(units={"angle": "deg", "power": "kW"}) as outlet:
        outlet.offer(frames(1))
        await clients_see_the_cells_values(outlet)
        await our_own_inlet_reads_them(outlet)
        await what_a_reload_adds_is_there_too(outlet)
        await nobody_acknowledges_without_a_name(outlet)
        await too_much_is_refused_before_it_is_done(outlet)
        await idle_connections_and_endless_messages_are_cut_off(outlet)
        assert outlet.account.residue == 0


async def clients_see_the_cells_values(outlet: OpcUaOutlet) -> None:
    outlet.health({"state": "green", "time": EPOCH})
    energy = Energy("arm", "task_1", "speed=1.00", 1, EPOCH, EPOCH + 10**9, 1234.5, {}, 1.0, 1.0, 50.0, 0.0, None)
    outlet.offer(energy)
    async with client(outlet) as there:
        power = await has_value(there, "mains.supply.power")
        assert power.Value.Value == pytest.approx(0.6)
        assert round(power.SourceTimestamp.timestamp() * 1e3) == (EPOCH + LAYOUT.step) // 1_000_000
        position = await has_value(there, "arm.joint_1.position")
        assert position.Value.Value == pytest.approx(np.degrees(0.5))
        assert (await has_value(there, "energy:arm.task_1")).Value.Value == 1234.5
        assert (await has_value(there, "Health")).Value.Value in ("{}", f'{{"state":"green","time":{EPOCH}}}')
        space = await there.get_namespace_index(OWN)
        assert (await unit_of(there, "mains.supply.power")).UnitId == 4937556  # KWT, as the table of OPC 10000-8 has it
        with pytest.raises(ua.UaStatusCodeError):
            await there.get_node(ua.NodeId("Health", space)).write_value("{}")
        outlet.offer(frames(2, [np.nan] * 5, Quality.MISSING))

        async def bad() -> bool:
            return (await value(there, "mains.supply.power")).StatusCode.name == "BadNoCommunication"

        await eventually(bad, "a bad value")


async def our_own_inlet_reads_them(outlet: OpcUaOutlet) -> None:
    outlet.offer(frames(3))
    async with client(outlet) as there:
        await has_value(there, "arm.joint_1.position")
    host, port = outlet.url.removeprefix("opc.tcp://").removesuffix("/cellwatt").split(":")
    tags = {f"joint_1.{name}": {"node": f"ns=own;s=arm.joint_1.{name}", "unit": unit} for name, unit in JOINT.items()}
    tags["joint_1.position"] |= {"unit": "deg"}
    settings = {"host": host, "port": port, "path": "/cellwatt", "namespaces": {"own": OWN}, "tags": tags}
    inlet = CollectingInlet()
    async with repeated(OpcUaDriver("arm", OpcUaSettings.model_validate(settings), inlet)) as run:
        await inlet.until(lambda o: bool(o.readings) or bool(run.failures))
    assert not run.failures
    assert inlet.values[0] == pytest.approx(VALUES[:4])


async def what_a_reload_adds_is_there_too(outlet: OpcUaOutlet) -> None:
    """A second arm, a second joint of the first arm, and a meter that gives another unit."""
    units = dict.fromkeys(("left.joint_1.position", "arm.joint_2.position", *LAYOUT.names), "rad")
    outlet.offer(frames_of(layout_of(units), 4, [EPOCH + 4 * LAYOUT.step], np.full((1, 7), 0.5)))
    async with client(outlet) as there:
        for name in ("left.joint_1.position", "arm.joint_2.position"):
            assert (await has_value(there, name)).Value.Value == pytest.approx(np.degrees(0.5))
        assert (await unit_of(there, "mains.supply.power")).DisplayName.Text == "deg"
    outlet.offer(frames(5))


class Listener:
    """Keeps events."""

    def __init__(self) -> None:
        self.events: list[Any] = []

    def event_notification(self, event: Any) -> None:
        self.events.append(event)

    def states(self) -> list[tuple[bool, bool, bool]]:
        return [(getattr(e, "ActiveState/Id"), getattr(e, "AckedState/Id"), e.Retain) for e in self.events]


async def listening(there: Client) -> tuple[Listener, Any]:
    """A listener to the cell's alarms, and its subscription."""
    listener = Listener()
    subscription = await there.create_subscription(20, listener)
    await subscription.subscribe_alarms_and_conditions(evtypes=ua.ObjectIds.AlarmConditionType)
    return listener, subscription


async def guesses_have_to_wait(outlet: OpcUaOutlet) -> None:
    async def guessed() -> bool:
        with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
            async with client(outlet, "adam", "guess"):
                pass
        return bool(outlet.account.counters["logins refused"])

    await eventually(guessed, "a try that has to wait")
    assert outlet.account.counters["failed logins"] >= 5
    async with client(outlet, "eve", "secret") as there:
        assert await there.get_namespace_index(OWN)


async def test_an_alarm_is_a_condition_that_users_acknowledge():
    async with a_cell(users={"eve": "secret"}) as outlet, client(outlet, "eve", "secret") as there:
        await guesses_have_to_wait(outlet)
        listener, _ = await listening(there)
        outlet.offer(alarm(1))
        await eventually(lambda: listener.events)
        raised = listener.events[0]
        assert raised.Message.Text == "Joint 1 needs more power than it should."
        assert (raised.Severity, raised.ConditionName, raised.SourceName) == (800, "joint_fault", "arm")
        condition = there.get_node(raised.NodeId)
        note = ua.LocalizedText("on my way")
        with pytest.raises(ua.UaStatusCodeError, match="BadEventIdUnknown"):
            await condition.call_method(ACKNOWLEDGE, b"another", note)
        for foreign in (ua.Variant(2**31, ua.VariantType.UInt32), ua.Variant("event", ua.VariantType.String)):
            with pytest.raises(ua.UaStatusCodeError, match="BadEventIdUnknown"):
                await condition.call_method(ACKNOWLEDGE, foreign, note)
        await condition.call_method(ACKNOWLEDGE, raised.EventId, note)
        assert outlet.view.ordered == [("acknowledge", "alarm-1", "eve", "on my way")]
        data = {"alarm": "alarm-1", "name": "eve", "note": "on my way"}
        outlet.offer(Event(EPOCH, None, "acknowledged", "eve acknowledged alarm-1", data))
        await eventually(lambda: len(listener.events) > 1)
        with pytest.raises(ua.UaStatusCodeError, match="BadConditionBranchAlreadyAcked"):
            await condition.call_method(ACKNOWLEDGE, listener.events[1].EventId, note)
        await one_that_comes_later_asks_for_what_stands(outlet)
        outlet.offer(alarm(1, active=False))
        await eventually(lambda: len(listener.events) > 2)
        assert listener.states() == [(True, False, True), (True, True, True), (False, True, False)]
        outlet.offer(alarm(13))  # which is over when somebody acknowledges it
        await eventually(lambda: len(listener.events) > 3)
        other = listener.events[3]
        with pytest.raises(ua.UaStatusCodeError, match="BadInvalidState"):
            await there.get_node(other.NodeId).call_method(ACKNOWLEDGE, other.EventId, note)


async def test_a_new_process_takes_alarms_and_acknowledgements_from_the_health():
    """Messages of before its start may have left the journal, and what is restored after a restart has no event."""
    async with a_cell() as outlet, client(outlet) as there:
        listener, _ = await listening(there)
        word = {"name": "eve", "note": "on my way", "time": EPOCH}
        for time, alarms in ((1, [asdict(alarm(1)) | {"acknowledged": word}]), (2, []), (3, [])):
            outlet.health({"state": "green", "time": EPOCH + time * 10**9, "alarms": alarms})
            await eventually(lambda n=time: len(listener.events) >= min(n, 2))
        assert listener.states() == [(True, True, True), (False, True, False)]
        assert listener.events[0].Comment.Text == "on my way" and listener.events[0].ClientUserId == "eve"


async def one_that_comes_later_asks_for_what_stands(outlet: OpcUaOutlet) -> None:
    async with client(outlet, "eve", "secret") as later:
        listener, subscription = await listening(later)
        kind = later.get_node(ua.ObjectIds.ConditionType)
        refresh = ua.NodeId(ua.ObjectIds.ConditionType_ConditionRefresh)
        await kind.call_method(refresh, ua.Variant(subscription.subscription_id, ua.VariantType.UInt32))
        await eventually(lambda: listener.events)
        assert listener.states() == [(True, True, True)]
        assert listener.events[0].ConditionName == "joint_fault"


async def nobody_acknowledges_without_a_name(outlet: OpcUaOutlet) -> None:
    async with client(outlet) as there:
        listener, _ = await listening(there)
        outlet.offer(alarm(1))
        await eventually(lambda: listener.events)
        raised = listener.events[0]
        with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
            await there.get_node(raised.NodeId).call_method(ACKNOWLEDGE, raised.EventId, ua.LocalizedText(""))
        assert not outlet.view.ordered


async def too_much_is_refused_before_it_is_done(outlet: OpcUaOutlet) -> None:
    """Limits are announced in the standard's nodes, and what is beyond them costs nobody any time."""
    async with client(outlet) as there, client(outlet) as other:
        for name, limit in LIMITS.items():
            node = there.get_node(getattr(ua.ObjectIds, f"Server_ServerCapabilities_{name}"))
            assert await node.read_value() == limit, name
        (server,) = children(OpcUaOutlet.module)
        before = server.memory_info().rss
        names = [ua.ReadValueId(ua.NodeId(ua.ObjectIds.Server), ua.AttributeIds.DisplayName)]
        ask = there.uaclient.read
        assert len(await ask(ua.ReadParameters(NodesToRead=names * 1000))) == 1000
        with pytest.raises(ua.UaStatusCodeError, match="BadTooManyOperations"):
            await ask(ua.ReadParameters(NodesToRead=names * 5000))
        paths = [ua.BrowsePath(ua.NodeId(ua.ObjectIds.RootFolder), ua.RelativePath())] * 1001
        with pytest.raises(ua.UaStatusCodeError, match="BadTooManyOperations"):
            await there.uaclient.translate_browsepaths_to_nodeids(paths)
        many = [await there.create_subscription(1, Listener()) for _ in range(SUBSCRIPTIONS_OF_SESSION)]
        with pytest.raises(ua.UaStatusCodeError, match="BadTooManySubscriptions"):
            await there.create_subscription(1000, Listener())
        with pytest.raises(ua.UaStatusCodeError, match="BadSubscriptionIdInvalid"):
            await other.uaclient.delete_subscriptions([many[0].subscription_id])
        with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):  # beyond the size of any request
            await asyncio.wait_for(ask(ua.ReadParameters(NodesToRead=names * 50_000)), 10)
        assert (await has_value(other, "mains.supply.power")).StatusCode.is_good()
        assert server.memory_info().rss - before < 50e6


async def idle_connections_and_endless_messages_are_cut_off(outlet: OpcUaOutlet) -> None:
    host, port = outlet.url.removeprefix("opc.tcp://").removesuffix("/cellwatt").split(":")
    idle = [await asyncio.open_connection(host, int(port)) for _ in range(100)]
    async with client(outlet) as there:
        assert await there.get_namespace_index(OWN)
    reader, writer = await asyncio.open_connection(host, int(port))
    with pytest.raises(ConnectionError):
        writer.write(b"HELF" + (2**31).to_bytes(4, "little"))
        for _ in range(200):
            writer.write(bytes(65536))
            await writer.drain()
        await reader.readexactly(1)
    await eventually(lambda: outlet.account.counters["connections displaced"] >= 50)
    for _, each in [*idle, (reader, writer)]:
        each.close()
        with suppress(OSError):
            await each.wait_closed()


@pytest.mark.slow
async def test_a_stranger_with_a_certificate_or_a_password_stays_out(tmp_path):
    server, known, stranger = (certificate(tmp_path, name) for name in ("server", "client", "stranger"))
    secure = {"certificate": server[0], "key": server[1], "trusted": [known[0]], "users": {"eve": "secret"}}
    async with a_cell(**secure) as outlet:
        for (certificate_, key), user, password, refused in (
            (known, "eve", "secret", None),
            (known, "eve", "guessed", "BadUserAccessDenied"),
            (stranger, "eve", "secret", "BadCertificateUntrusted"),
        ):
            made = Client(outlet.url)
            made.application_uri = f"urn:test:{certificate_.stem}"
            mode = ua.MessageSecurityMode.SignAndEncrypt
            await made.set_security(SecurityPolicyBasic256Sha256, str(certificate_), str(key), mode=mode)
            made.set_user(user)
            made.set_password(password)
            if refused is None:
                async with made:
                    assert await made.get_namespace_index(OWN)
            else:
                with pytest.raises(ua.UaStatusCodeError, match=refused):
                    await made.connect()
        plain = Client(outlet.url)
        with pytest.raises((ua.UaError, OSError, TimeoutError)):
            await plain.connect()


def test_an_array_is_no_longer_than_its_message(monkeypatch):
    """2**31 - 1 empty items: the library would make them all."""
    for name in READERS:
        monkeypatch.setattr(ua_binary, name, getattr(ua_binary, name))
    bound_arrays()
    with pytest.raises(NotEnoughData, match="an array of 2147483647 items in 4 bytes"):
        ua_binary.variant_from_binary(Buffer(b"\x80\xff\xff\xff\x7f"))
    for value in ([1.5, 2.5], ["a", ""], None):
        told = ua_binary.variant_to_binary(ua.Variant(value))
        assert ua_binary.variant_from_binary(Buffer(told)).Value == value


def test_what_is_left_open_on_purpose_is_warned_of_once_and_shows_no_password():
    settings = OpcUaOutletSettings.model_validate({"listen": "0.0.0.0:4840", "open": True, "users": {"eve": "s3cret"}})
    assert len(settings.warnings()) == 1
    assert "s3cret" not in repr(settings)
