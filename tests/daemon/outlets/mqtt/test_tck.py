# ruff: noqa: E501 (a rule is a line)
"""The rules of Sparkplug 3.0 for an edge node, by the ids of its Technology Compatibility Kit, on one long scene.

All that the edge node says is taken from the wire, between it and a real Mosquitto, and decoded by hand. Words are ours.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from cellwatt import Task
from tests.daemon.outlets.mqtt.broker import Broker, Ears, ears, needs_mosquitto
from tests.daemon.outlets.mqtt.cell import Cell, alarm, outlet_of, serving
from tests.daemon.outlets.mqtt.wire import CONNECT, DISCONNECT, PUBLISH, SUBSCRIBE, Packet, Tap, command
from tests.patience import eventually

pytestmark = needs_mosquitto

NODE, STATE = "spBv1.0/plant-1/{}/weld-3", "spBv1.0/STATE/scada"
NCMD = NODE.format("NCMD")
BIRTHS, DATA = ("NBIRTH", "DBIRTH"), ("NDATA", "DDATA")
T0 = 1_000


class Scene(NamedTuple):
    """All that the node said, connection by connection; ``marks`` are numbers of packets said at certain moments."""

    connections: list[list[Packet]]
    marks: dict[str, int]

    @property
    def all(self) -> list[Packet]:
        return [p for c in self.connections for p in c]

    def of(self, *verbs: str) -> list[Packet]:
        return [p for p in self.all if p.kind == PUBLISH and p.verb in verbs]

    @property
    def connects(self) -> list[Packet]:
        return [p for p in self.all if p.kind == CONNECT]

    @property
    def metrics(self) -> list[tuple[Packet, dict[str, Any]]]:
        return [(p, m) for p in self.of(*BIRTHS, *DATA) for m in p.body["metrics"]]


async def _scene(tap: Tap, broker: Broker, folder: Path) -> Scene:
    cell = Cell(folder)
    marks: dict[str, int] = {}
    async with ears(broker, "nothing") as host:
        outlet = outlet_of(cell, tap.url, format="sparkplug", sparkplug={"primary_host": "scada"}, backfill="1 kHz")

        async def state(online: bool, timestamp: int) -> None:
            await host.say(STATE, json.dumps({"online": online, "timestamp": timestamp}).encode(), retain=True)

        async with serving(outlet, cell):
            await _waits_for_its_host(tap, state, marks)
            outlet.offer(cell.frames(2))
            outlet.offer(alarm(1))
            outlet.offer(Task("arm", "task_1", "ab", "speed=1.00", 1.0, cell.start, cell.start + 10**9, (1,), 4))
            await eventually(lambda: tap.verbs().count("DDATA") >= 2 and tap.verbs().count("NBIRTH") >= 2, "data")
            await _is_born_anew(tap, host, marks)
            await _loses_and_finds_a_device(tap, outlet, cell)
            for _ in range(300):  # more than the numbers there are
                outlet.offer(cell.frames(1))
            await eventually(lambda: tap.verbs().count("DDATA") >= 600, "much data")
            await eventually(lambda: not outlet._outbox.rows, "sent")
            await _loses_its_host(tap, outlet, cell, state, marks)
            await asyncio.to_thread(tap.cut)
            await eventually(lambda: not outlet._outbox.serving, "the cut is noticed")
            outlet.offer(cell.frames(20))
            tap.restore()
            await eventually(lambda: len(tap.streams) > marks["streams"] and outlet._outbox.serving, "back")
            outlet.offer(cell.frames(150))
            await eventually(lambda: outlet._cursor.first is None and not outlet._outbox.rows, "all is filled")
        await eventually(lambda: tap.said()[-1].kind == DISCONNECT, "good-bye")
        cell.close()
        return Scene(tap.connections, marks)


async def _settled(host: Ears) -> None:
    """Wait until what was on its way has had its effect."""
    for _ in range(5):
        await host.say("something/else", b"")
        await asyncio.sleep(0.02)


async def _waits_for_its_host(tap: Tap, state: Any, marks: dict[str, int]) -> None:
    async def quiet(name: str) -> None:
        await asyncio.sleep(0.1)
        marks[name] = tap.verbs().count("NBIRTH")

    await eventually(lambda: any(p.kind == SUBSCRIBE for p in tap.said()), "subscriptions")
    await quiet("births without a state")
    await state(False, T0)
    await quiet("births with the host offline")
    await state(True, T0 - 1)
    await quiet("births after an old online")
    await state(True, T0 + 1)
    await eventually(lambda: "NBIRTH" in tap.verbs(), "births")


async def _is_born_anew(tap: Tap, host: Ears, marks: dict[str, int]) -> None:
    before = tap.verbs().count("NBIRTH")
    await host.say(NCMD, command("Node Control/Rebirth", False))
    await host.say(NCMD, command("Something else", True))
    await host.say(NCMD, b"no payload")
    await _settled(host)
    marks["births without a request"] = tap.verbs().count("NBIRTH") - before
    marks["rebirth"] = len(tap.said())
    await host.say(NCMD, command("Node Control/Rebirth", True))
    await eventually(lambda: tap.verbs().count("NBIRTH") == before + 1, "rebirth")
    await eventually(lambda: tap.verbs()[-2:].count("DBIRTH") == 2, "devices too")


async def _loses_and_finds_a_device(tap: Tap, outlet: Any, cell: Cell) -> None:
    outlet.offer(cell.frames(1, missing=("meter",)))
    await eventually(lambda: "DDEATH" in tap.verbs(), "a device is gone")
    outlet.offer(cell.frames(2, missing=("meter",)))
    outlet.offer(cell.frames(1))
    await eventually(lambda: tap.verbs()[::-1].index("DBIRTH") < tap.verbs()[::-1].index("DDEATH"), "it is back")


async def _loses_its_host(tap: Tap, outlet: Any, cell: Cell, state: Any, marks: dict[str, int]) -> None:
    await state(False, T0)
    await asyncio.sleep(0.1)
    marks["deaths after an old offline"] = tap.verbs().count("NDEATH")
    await state(False, T0 + 2)
    await eventually(lambda: len(tap.streams) == 2, "it leaves, and comes again")
    outlet.offer(cell.frames(10))
    await asyncio.sleep(0.1)
    marks["births of the second connection without the host"] = tap.verbs().count("NBIRTH")
    await state(True, T0 + 3)
    await eventually(lambda: any(p.verb == "DBIRTH" for p in tap.connections[-1]), "back")
    marks["streams"] = len(tap.streams)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("sparkplug")
    broker = Broker(folder)
    broker.start()
    try:
        with Tap(broker.port) as tap:
            return asyncio.run(_scene(tap, broker, folder))
    finally:
        broker.kill()


# rules --------------------------------------------------------------------------------------------

Rule = tuple[str, str, Callable[[Scene], Any]]


def named(packet: Packet, name: str) -> dict[str, Any]:
    (found,) = (m for m in packet.body["metrics"] if m.get("name") == name)
    return found


def follows(packets: Iterable[Packet]) -> bool:
    """Each number is one more than that of the message before, 0 after 255, and that of an NBIRTH is 0."""
    before = None
    for p in packets:
        number = p.body["seq"]
        if p.verb == "NBIRTH":
            assert number == 0
        elif before is None or number != (before + 1) % 256:
            return False
        before = number
    return before is not None


def sequences(scene: Scene) -> bool:
    live = ([p for p in c if p.kind == PUBLISH and p.verb and p.verb != "NDEATH"] for c in scene.connections)
    return all(follows(packets) for packets in live if packets)


def plainly(*verbs: str) -> Callable[[Scene], bool]:
    return lambda s: all((p.qos, p.retain) == (0, False) for p in s.of(*verbs)) and all(s.of(v) for v in verbs)


def stamped(*verbs: str) -> Callable[[Scene], bool]:
    return lambda s: all(1.7e12 < p.body["timestamp"] < 3e12 for p in s.of(*verbs))


def every(verb: str, rule: Callable[[Packet], Any]) -> Callable[[Scene], bool]:
    return lambda s: bool(s.of(verb)) and all(rule(p) for p in s.of(verb))


def wills(rule: Callable[[Packet], Any]) -> Callable[[Scene], bool]:
    return lambda s: all(p.will and rule(p) for p in s.connects)


def birth_order(scene: Scene) -> bool:
    """After each NBIRTH, before other data, come the births of all devices that were alive just before."""
    said, alive = [p for p in scene.all if p.kind == PUBLISH and p.verb], set()
    for i, p in enumerate(said):
        device = p.topic.split("/")[4:]
        if p.verb == "NBIRTH":
            after = said[i + 1 : i + 1 + len(alive)]
            if any(q.verb != "DBIRTH" for q in after):
                return False
        alive |= set(device) if p.verb == "DBIRTH" else set()
        alive -= set(device) if p.verb == "DDEATH" else set()
        alive = set() if p.verb == "NDEATH" else alive
    return True


def known_aliases(scene: Scene) -> bool:
    """Data name no metric; each alias is of the last birth of its node or device."""
    for connection in scene.connections:
        declared: dict[str, set[int]] = {}
        for p in connection:
            where = p.topic.split("/", 3)[-1]
            if p.verb in BIRTHS:
                declared[where] = {m["alias"] for m in p.body["metrics"] if "alias" in m}
            elif p.verb in DATA and not all(
                "name" not in m and m["alias"] in declared[where] for m in p.body["metrics"]
            ):
                return False
    return True


def unique_aliases(scene: Scene) -> bool:
    names: dict[int, set[str]] = {}
    for p, m in scene.metrics:
        if "name" in m and "alias" in m:
            names.setdefault(m["alias"], set()).add(f"{p.topic.split('/')[4:]}{m['name']}")
    return bool(names) and all(len(found) == 1 for found in names.values())


def complete(scene: Scene) -> bool:
    """Births have name, datatype and value, or say that there is none."""
    born = [m for p in scene.of(*BIRTHS) for m in p.body["metrics"]]
    return all({"name", "datatype"} <= m.keys() and ("value" in m) != bool(m.get("is_null")) for m in born)


def rebirth(scene: Scene) -> list[Packet]:
    """What was said from the rebirth request on."""
    return scene.all[scene.marks["rebirth"] :]


def chronological(scene: Scene) -> bool:
    now = [[m["timestamp"] for m in p.body["metrics"] if not m.get("is_historical")] for p in scene.of(*DATA)]
    return all(times == sorted(times) for times in now)


def historical(scene: Scene) -> bool:
    """What was measured while nobody heard comes as historical, once, in order, with its own time."""
    times = [m["timestamp"] for p, m in scene.metrics if m.get("is_historical") and p.topic.endswith("/meter")]
    return len(times) == 30 and times == sorted(set(times))


TYPES = {4: "long", 8: "long", 10: "double", 11: "boolean", 12: "string", 13: "long"}
OF_DEVICES = [*product(("DBIRTH", "DDATA"), ("arm", "meter")), ("DDEATH", "meter")]
TOPICS = {NODE.format(v) for v in ("NBIRTH", "NDATA", "NDEATH")} | {f"{NODE.format(v)}/{d}" for v, d in OF_DEVICES}
_BD = "bdSeq"
_RE = "Node Control/Rebirth"

# fmt: off
RULES: list[Rule] = [
    ("topic-structure topic-structure-namespace-a topic-structure-namespace-valid-group-id topic-structure-namespace-valid-edge-node-id topic-structure-namespace-valid-device-id topics-dbirth-topic message-flow-device-birth-publish-dbirth-topic message-flow-device-birth-publish-dbirth-match-edge-node-topic topic-structure-namespace-unique-device-id topics-ddata-topic topic-structure-namespace-device-id-associated-message-types topic-structure-namespace-device-id-non-associated-message-types topics-nbirth-topic message-flow-edge-node-birth-publish-nbirth-topic topics-ndata-topic topics-ndeath-topic topics-ddeath-topic", "topics are spBv1.0/group/type/node, and /device where a device speaks", lambda s: {p.topic for p in s.all if p.kind == PUBLISH} == TOPICS),
    ("topics-nbirth-mqtt payloads-nbirth-qos payloads-nbirth-retain message-flow-edge-node-birth-publish-nbirth-qos message-flow-edge-node-birth-publish-nbirth-retained topics-ndata-mqtt payloads-ndata-qos payloads-ndata-retain topics-dbirth-mqtt payloads-dbirth-qos payloads-dbirth-retain message-flow-device-birth-publish-dbirth-qos message-flow-device-birth-publish-dbirth-retained topics-ddata-mqtt payloads-ddata-qos payloads-ddata-retain topics-ddeath-mqtt", "quality of service 0, not retained", plainly(*BIRTHS, *DATA, "DDEATH")),
    ("topics-nbirth-seq-num payloads-nbirth-seq payloads-sequence-num-req-nbirth message-flow-edge-node-birth-publish-nbirth-payload-seq", "its number is 0", every("NBIRTH", lambda p: p.body["seq"] == 0)),
    ("topics-nbirth-metric-reqs topics-dbirth-metric-reqs operational-behavior-data-publish-nbirth operational-behavior-data-publish-dbirth payloads-alias-data-cmd-requirement payloads-name-requirement", "has every metric that data will have; data have aliases and no names", known_aliases),
    ("topics-nbirth-metrics topics-dbirth-metrics operational-behavior-data-publish-nbirth-values operational-behavior-data-publish-dbirth-values payloads-alias-birth-requirement payloads-metric-datatype-req", "name, datatype and value of each", complete),
    ("topics-nbirth-bdseq-matching", "bdSeq is that of the will", lambda s: all(named(p, _BD)["value"] == named(c[0], _BD)["value"] for c in s.connections for p in c if p.verb == "NBIRTH" and p.kind == PUBLISH)),
    ("topics-nbirth-bdseq-increment", "bdSeq is 0 at first and one more at each connection", lambda s: [named(p, _BD)["value"] for p in s.connects] == list(range(len(s.connects)))),
    ("topics-nbirth-rebirth-metric operational-behavior-data-commands-rebirth-value operational-behavior-data-commands-rebirth-name payloads-nbirth-rebirth-req operational-behavior-data-commands-rebirth-datatype operational-behavior-data-commands-rebirth-name-aliases", "has the command for a rebirth: a Boolean, false, without an alias", every("NBIRTH", lambda p: [named(p, _RE).get(what) for what in ("value", "datatype", "alias")] == [False, 11, None])),
    ("payloads-nbirth-bdseq-repeat", "a rebirth has the same bdSeq", lambda s: len({named(p, _BD)["value"] for p in s.connections[0] if p.kind == PUBLISH and p.verb == "NBIRTH"}) == 1 < len([p for p in s.connections[0] if p.verb == "NBIRTH"])),
    ("topics-ndata-payload topics-ddata-payload message-flow-device-birth-publish-dbirth-payload", "births and data have metrics", lambda s: all(p.body["metrics"] for p in s.of("DBIRTH", *DATA))),
    ("payloads-ndata-order payloads-dbirth-order payloads-ddata-order", "after all births", birth_order),
    ("topics-ndeath-payload", "bdSeq and nothing else", every("NDEATH", lambda p: [m["name"] for m in p.body["metrics"]] == [_BD])),
    ("topics-ndeath-seq", "no number", every("NDEATH", lambda p: "seq" not in p.body)),
    ("payloads-ndeath-seq", "no number in the will either", wills(lambda p: "seq" not in p.body)),
    ("payloads-ndeath-will-message-qos message-flow-edge-node-birth-publish-will-message-qos payloads-ndeath-will-message-retain message-flow-edge-node-birth-publish-will-message-will-retained", "quality of service 1, not retained", wills(lambda p: (p.qos, p.retain) == (1, False))),
    ("payloads-ndeath-bdseq", "bdSeq of the birth", lambda s: all(named(p, _BD)["value"] == named(c[0], _BD)["value"] for c in s.connections for p in c if p.verb == "NDEATH")),
    ("payloads-ndeath-will-message-publisher operational-behavior-edge-node-intentional-disconnect-ndeath", "published before we leave on purpose", lambda s: s.of("NDEATH") == [p for c in s.connections for p in c[-2:-1] if c[-1].kind == DISCONNECT and p.verb == "NDEATH"] and len(s.of("NDEATH")) == 2),
    ("payloads-ndeath-will-message-publisher-disconnect-mqtt50", "the good-bye asks for the will", lambda s: all(p.reason == 4 for p in s.all if p.kind == DISCONNECT)),
    ("operational-behavior-device-ddeath", "a source without values dies, once", lambda s: [p.topic[-5:] for p in s.of("DDEATH")] == ["meter"]),
    ("payloads-timestamp-in-UTC topics-nbirth-timestamp payloads-nbirth-timestamp topics-ndata-timestamp payloads-ndata-timestamp topics-dbirth-timestamp payloads-dbirth-timestamp topics-ddata-timestamp payloads-ddata-timestamp payloads-ddeath-timestamp", "ms of UTC", stamped(*BIRTHS, *DATA, "DDEATH")),
    ("payloads-sequence-num-incrementing topics-ndata-seq-num payloads-ndata-seq-inc topics-dbirth-seq payloads-dbirth-seq-inc topics-ddata-seq-num payloads-ddata-seq-inc topics-ddeath-seq-num payloads-ddeath-seq-inc message-flow-device-birth-publish-dbirth-payload-seq payloads-sequence-num-always-included payloads-ndata-seq payloads-dbirth-seq payloads-ddata-seq payloads-ddeath-seq payloads-ddeath-seq-number", "all but deaths of nodes have a number, one more than the message before, 0 after 255", lambda s: sequences(s) and {p.body["seq"] for p in s.of("DDATA")} == set(range(256))),
    ("payloads-alias-uniqueness", "an alias is that of one metric of the whole node", unique_aliases),
    ("payloads-metric-timestamp-in-UTC payloads-name-birth-data-requirement", "each metric has its time, in ms of UTC", lambda s: all(1.7e12 < m["timestamp"] < 3e12 for _, m in s.metrics)),
    ("payloads-metric-datatype-value-type", "a datatype is a small number", lambda s: all(0 < m["datatype"] < 2**32 for _, m in s.metrics if "datatype" in m)),
    ("payloads-metric-datatype-value", "one of the specification's, with its field", lambda s: all(TYPES[m["datatype"]] == m["field"] for _, m in s.metrics if "datatype" in m and "value" in m)),
    ("payloads-metric-datatype-not-req", "data do not", lambda s: not any("datatype" in m for p, m in s.metrics if p.verb in DATA)),
    ("payloads-propertyset-keys-array-size payloads-propertyset-values-array-size", "as many keys as values", lambda s: any(m.get("properties") for _, m in s.metrics)),
    ("payloads-metric-propertyvalue-type-req", "births say the type of a property", lambda s: {t for p, m in s.metrics for t, _ in m.get("properties", {}).values()} == {12}),
    ("principles-persistence-clean-session-50", "a clean start, and no session that outlives it", lambda s: all(p.clean and p.expiry == 0 for p in s.connects)),
    ("principles-birth-certificates-order message-flow-device-birth-publish-nbirth-wait", "a birth is the first message", lambda s: all(p.verb == "NBIRTH" for c in s.connections for p in [p for p in c if p.kind == PUBLISH][:1])),
    ("principles-rbe-recommended", "what did not change is not sent", lambda s: all(m["value"] != 0.0 for p, m in s.metrics if p.verb == "DDATA" and "value" in m and not m.get("is_historical"))),
    ("message-flow-edge-node-ncmd-subscribe message-flow-edge-node-birth-publish-phid-wait-id", "commands, and the state of its host, are listened to with quality of service 1", lambda s: all({(NCMD, 1), (STATE, 1)} <= {f for p in c if p.kind == SUBSCRIBE for f in p.filters} for c in s.connections)),
    ("message-flow-edge-node-birth-publish-connect", "births come after the connection", lambda s: all(c[0].kind == CONNECT for c in s.connections)),
    ("message-flow-edge-node-birth-publish-will-message-topic message-flow-edge-node-birth-publish-will-message payloads-ndeath-will-message", "there is a will, an NDEATH, with its topic", wills(lambda p: p.topic == NODE.format("NDEATH"))),
    ("message-flow-edge-node-birth-publish-will-message-payload-bdSeq message-flow-edge-node-birth-publish-will-message-payload", "bdSeq as Int64, one more at each connection", wills(lambda p: named(p, _BD)["datatype"] == 4)),
    ("message-flow-edge-node-birth-publish-nbirth-payload-bdSeq topics-nbirth-bdseq-included payloads-nbirth-bdseq message-flow-edge-node-birth-publish-nbirth-payload", "bdSeq as Int64", every("NBIRTH", lambda p: named(p, _BD)["datatype"] == 4)),
    ("operational-behavior-edge-node-intentional-disconnect-packet", "then the good-bye", lambda s: sum(p.kind == DISCONNECT for p in s.all) == 2),
    ("message-flow-edge-node-birth-publish-phid-wait", "nothing before the primary host is online", lambda s: s.marks["births without a state"] == 0),
    ("message-flow-edge-node-birth-publish-phid-wait-online", "offline is not online", lambda s: s.marks["births with the host offline"] == 0),
    ("message-flow-edge-node-birth-publish-phid-wait-timestamp", "an older state does not count", lambda s: s.marks["births after an old online"] == 0),
    ("message-flow-edge-node-birth-publish-phid-offline operational-behavior-edge-node-termination-host-offline", "it dies when the host goes offline, and leaves", lambda s: [p.verb or p.kind for p in s.connections[0][-2:]] == ["NDEATH", DISCONNECT]),
    ("operational-behavior-edge-node-termination-host-offline-reconnect", "and connects anew", lambda s: len(s.connections) >= 3),
    ("operational-behavior-edge-node-termination-host-offline-timestamp", "but not for an older state", lambda s: s.marks["deaths after an old offline"] == 0),
    ("operational-behavior-edge-node-birth-sequence-wait", "the new connection waits for the host as well", lambda s: s.marks["births of the second connection without the host"] == sum(p.verb == "NBIRTH" for p in s.connections[0])),
    ("operational-behavior-data-publish-nbirth-order operational-behavior-data-publish-dbirth-order", "in order of time", chronological),
    ("store-and-forward", "what nobody heard is historical", historical),
    ("operational-behavior-data-commands-ncmd-rebirth-name operational-behavior-data-commands-ncmd-rebirth-value", "only that command counts", lambda s: s.marks["births without a request"] == 0),
    ("operational-behavior-data-commands-rebirth-action-2 operational-behavior-data-commands-rebirth-action-1", "data stop, all births follow", lambda s: [p.verb for p in rebirth(s)[:3]] == ["NBIRTH", "DBIRTH", "DBIRTH"]),
    ("operational-behavior-data-commands-rebirth-action-3", "with the same bdSeq", lambda s: named(rebirth(s)[0], _BD)["value"] == 0),
    ("case-sensitivity-metric-names", "no two names differ in case alone", lambda s: all(len({m["name"].lower() for m in p.body["metrics"]}) == len(p.body["metrics"]) for p in s.of(*BIRTHS))),
]
# fmt: on


@pytest.mark.parametrize(("words", "rule"), [rule[1:] for rule in RULES], ids=[rule[0] for rule in RULES])
def test_rule(scene: Scene, words: str, rule: Callable[[Scene], Any]) -> None:
    assert rule(scene), words


def test_values_and_units_are_those_of_the_frames(scene: Scene) -> None:
    """The value n belongs to the frame n of the joint, 100 n to the counter."""
    (first, *_) = [p for p in scene.of("DBIRTH") if p.topic.endswith("/arm")]
    told = {m["name"]: (m["value"], m["properties"]["engUnit"]) for m in first.body["metrics"]}
    assert told == {"joint_1/position": (0.0, (12, "rad")), "supply/power": (0.0, (12, "W"))}
    aliases = {m["alias"]: m["name"] for m in first.body["metrics"]}
    for p, m in scene.metrics:
        if p.verb == "DDATA" and p.topic.endswith("/arm") and aliases[m["alias"]] == "supply/power":
            position = next(o["value"] for o in p.body["metrics"] if aliases[o["alias"]] == "joint_1/position")
            assert m["value"] == 10 * position
