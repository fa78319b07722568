"""The edge node without a broker: numbers and aliases are right in any order of connections, rebirths and data."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from cellwatt import Alarm, AlarmBook, Energy, Event, Task
from cellwatt.errors import ProtocolError
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.message import Message, Order
from cellwatt.outlets.mqtt.payload import DataType, decode, encode, metric
from cellwatt.outlets.mqtt.settings import SparkplugSettings
from cellwatt.outlets.selection import Row
from tests.daemon.outlets.mqtt.wire import command, payload

T = 1_800_000_000_000_000_000
MS = 10**6
CHANNELS = {"arm.joint_1.position": "rad", "arm.supply.power": "W", "meter.energy": "J", "meter.count": "1"}


def units(names) -> dict[str, str]:
    return {n: CHANNELS[n] for n in names}


def row(time, values) -> Row:
    """A row of channels, ``None`` where there is no value."""
    known = {n: v for n, v in values.items() if v is not None}
    return Row(time, T + time * MS, known, {n: 4 if v is None else 0 for n, v in values.items()})


ROWS = st.dictionaries(st.sampled_from(list(CHANNELS)), st.none() | st.floats(-9, 9), min_size=1)


class Host:
    """What a host application makes of the messages; fails where it could not understand one."""

    def __init__(self) -> None:
        self.birth: int | None = None
        """bdSeq of the will of this connection."""
        self.online = False
        self.expected = 0
        self.aliases: dict[int, tuple[str, str]] = {}
        self.values: dict[tuple[str, str], object] = {}
        self.alive: set[str] = set()
        self.history: list[tuple[tuple[str, str], int, object]] = []

    def connected(self, will: Message) -> None:
        body = payload(will.payload)
        (metric,) = body["metrics"]
        assert will.topic == "spBv1.0/g/NDEATH/n" and metric["name"] == "bdSeq" and "seq" not in body
        assert self.birth is None or metric["value"] == (self.birth + 1) % 256
        self.birth, self.online = metric["value"], False
        self.alive.clear()

    def hear(self, messages) -> None:
        for message in messages:
            _, group, verb, node, *device = message.topic.split("/")
            assert (group, node) == ("g", "n") and not message.retain
            body = payload(message.payload)
            if verb != "NDEATH":
                assert body["seq"] == (0 if verb == "NBIRTH" else self.expected)
                self.expected = (body["seq"] + 1) % 256
            getattr(self, f"_{verb}")(body["metrics"], *device)

    def _NBIRTH(self, metrics) -> None:
        assert {m["name"]: m.get("value") for m in metrics}["bdSeq"] == self.birth
        self.online = True
        self.alive.clear()
        self.aliases.clear()
        self._born(metrics, "")

    def _DBIRTH(self, metrics, device) -> None:
        assert self.online
        self.alive.add(device)
        self._born(metrics, device)

    def _born(self, metrics, device) -> None:
        for alias in [a for a, (where, _) in self.aliases.items() if where == device]:
            del self.aliases[alias]
        for m in metrics:
            if "alias" in m:
                assert m["alias"] not in self.aliases
                self.aliases[m["alias"]] = device, m["name"]
                self.values[device, m["name"]] = m.get("value")

    def _NDATA(self, metrics) -> None:
        assert self.online
        self._data(metrics, "")

    def _DDATA(self, metrics, device) -> None:
        assert self.online and device in self.alive and metrics
        self._data(metrics, device)

    def _data(self, metrics, device) -> None:
        for m in metrics:
            where = self.aliases[m["alias"]]
            assert where[0] == device
            if m.get("is_historical"):
                self.history.append((where, m["timestamp"], m.get("value")))
            else:
                self.values[where] = m.get("value")

    def _DDEATH(self, metrics, device) -> None:
        assert self.online and device in self.alive and not metrics
        self.alive.discard(device)

    def _NDEATH(self, metrics) -> None:
        assert metrics[0]["value"] == self.birth
        self.online = False


class Sessions(RuleBasedStateMachine):
    """Connections, cuts, rebirths, hosts that come and go, and data, in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.node = EdgeNode(
            SparkplugSettings(group="g", node="n", primary_host="h"), "site", "cell", AlarmBook(), births=250
        )
        self.host = Host()
        self.host.birth = 249
        self.connected = self.born = False
        self.known: dict[str, float | None] = {}
        """Values of the channels whose source was not removed."""
        self.sources: set[str] = set()
        self.state_at: int | None = None
        self.time = 0

    @property
    def now(self) -> int:
        self.time += 1
        return T + self.time * MS

    def learn(self, values) -> list[float | None]:
        """Note the values of sources that are there; return the others."""
        there = {n: v for n, v in values.items() if not self.sources or n.split(".")[0] in self.sources}
        self.known |= there
        return [v for n, v in values.items() if n not in there]

    @rule()
    def connect(self) -> None:
        self.host.connected(self.node.connect())
        self.connected, self.born = True, False
        assert not self.node.ready

    @precondition(lambda self: self.connected)
    @rule(online=st.booleans(), step=st.integers(-2, 2))
    def hears_of_the_host(self, online, step) -> None:
        stamp = (self.state_at or 10) + step
        was = self.node.ready
        told = json.dumps({"online": online, "timestamp": stamp}).encode()
        order = self.node.heard("spBv1.0/STATE/h", told, True)
        if self.state_at is not None and stamp < self.state_at:
            assert self.node.ready is was and order == ()
            return
        self.state_at = stamp
        assert self.node.ready is online
        assert order == (() if online == was else Order.BIRTH if online else Order.LEAVE)
        if order is Order.BIRTH:
            self.host.hear(self.node.birth(self.now))
            self.born = True
        if order is Order.LEAVE:
            self.host.hear(self.node.death(self.now))
            self.connected = self.born = False

    @precondition(lambda self: self.connected)
    @rule(wanted=st.booleans())
    def is_asked_for_a_rebirth(self, wanted) -> None:
        order = self.node.heard("spBv1.0/g/NCMD/n", command("Node Control/Rebirth", wanted), False)
        assert order == (Order.BIRTH if wanted and self.born else ())
        if order is Order.BIRTH and self.node.ready:
            self.host.hear(self.node.birth(self.now))

    @precondition(lambda self: self.born)
    @rule(names=st.sets(st.sampled_from(list(CHANNELS)), min_size=1))
    def has_other_channels(self, names) -> None:
        self.sources = {name.split(".")[0] for name in names}
        self.known = {name: value for name, value in self.known.items() if name.split(".")[0] in self.sources}
        self.host.hear(self.node.label(units(names), self.now))
        assert self.host.alive <= self.sources

    @precondition(lambda self: self.born)
    @rule(values=ROWS)
    def sends_a_row(self, values) -> None:
        before = len(self.host.history)
        self.host.hear(self.node.row(row(self.time, values), False, self.now))
        removed = self.learn(values)
        assert sorted(str(value) for *_, value in self.host.history[before:]) == sorted(map(str, removed))
        for name, value in values.items():
            device, _, short = name.partition(".")
            if self.sources and device not in self.sources:
                continue  # its values are history, also while a back-fill leaves it alive
            if device in self.host.alive:
                assert self.host.values[device, short.replace(".", "/")] == value
            else:
                assert all(v is None for n, v in self.known.items() if n.startswith(f"{device}."))

    @precondition(lambda self: not self.born)
    @rule(values=ROWS)
    def misses_a_row(self, values) -> None:
        self.node.missed(row(self.time, values))
        self.learn(values)

    @precondition(lambda self: self.born)
    @rule(values=ROWS)
    def back_fills_a_row(self, values) -> None:
        before = len(self.host.history)
        shown = {key: value for key, value in self.host.values.items() if key[0] in {"", *self.host.alive}}
        self.host.hear(self.node.row(row(self.time, values), True, self.now))
        told = self.host.history[before:]
        assert {(d, n): v for (d, n), _, v in told} == {
            (name.split(".")[0], name.partition(".")[2].replace(".", "/")): v for name, v in values.items()
        }
        assert all(at == (T + self.time * MS) // MS - 1 for _, at, _ in told)
        assert all(self.host.values.get(key) == value for key, value in shown.items()), "history changes no value"

    @precondition(lambda self: self.born)
    @rule(number=st.integers(0, 3), active=st.booleans(), late=st.booleans())
    def sends_an_alarm(self, number, active, late) -> None:
        told = Alarm(f"a{number}", "k", "error", active, T, T + self.time * MS, "It is so.")
        self.host.hear(self.node.result(told, late, self.now))
        if not late:
            assert self.host.values["", "alarms/last/id"] == f"a{number}"

    @precondition(lambda self: self.born)
    @rule(source=st.sampled_from(["arm", "other"]), total=st.floats(allow_nan=True))
    def sends_an_energy(self, source, total) -> None:
        energy = Energy(source, "task_1", "v", 1, T, T + 10**9, total, {"hold": 1.0}, 0.1, 2.0, 50.0)
        self.host.hear(self.node.result(energy, False, self.now))
        assert self.host.values["", f"{source}/energy/total"] == (total if math.isfinite(total) else None)
        assert not self.node.result(Event(T, None, "k", "t"), False, self.now)

    @precondition(lambda self: self.born)
    @rule(state=st.sampled_from(["green", "red"]))
    def tells_its_health(self, state) -> None:
        self.host.hear(self.node.health({"state": state}, self.now))
        assert self.host.values["", "health/state"] == state

    @precondition(lambda self: self.connected)
    @rule()
    def is_cut(self) -> None:
        self.connected = self.born = False

    @invariant()
    def a_birth_that_was_told_is_that_of_this_connection(self) -> None:
        assert not self.born or self.host.online


def born() -> tuple[EdgeNode, Host]:
    """A node whose birth its host has heard."""
    node, host = EdgeNode(SparkplugSettings(group="g", node="n"), "site", "cell", AlarmBook()), Host()
    host.connected(node.connect())
    host.hear(node.birth(T))
    return node, host


def test_a_channel_that_is_gone_keeps_its_unit_and_value_when_its_past_is_filled_in() -> None:
    node, host = born()
    node.label(units(CHANNELS), T)
    host.hear(node.row(row(1, {"arm.supply.power": 5.0, "arm.joint_1.position": 1.0}), False, T))
    node.label(units(["meter.count", "arm.joint_1.position"]), T)
    (data,) = node.row(row(0, {"arm.supply.power": None}), True, T)
    assert "/DDATA/" in data.topic, "it is the metric that was born"
    host.hear([data])
    assert host.values["arm", "supply/power"] == 5.0 and host.history[-1][2] is None


def test_a_source_that_a_reload_removed_is_dead_and_its_last_row_is_history() -> None:
    node, host = born()
    node.label(units(CHANNELS), T)
    host.hear(node.row(row(1, {"arm.supply.power": 5.0, "meter.count": 1.0}), False, T))
    host.hear(node.label(units(["meter.count"]), T))
    assert host.alive == {"meter"}
    host.hear(node.row(row(2, {"arm.supply.power": 6.0, "meter.count": 2.0}), False, T))  # made before the reload
    assert host.alive == {"meter"} and [value for *_, value in host.history] == [6.0]
    host.hear(node.birth(T))
    assert host.alive == {"meter"} and host.values["meter", "count"] == 2.0
    sent = [each for i in range(3, 9) for each in node.row(row(i, {"arm.supply.power": 1.0 * i}), i % 3 != 0, T)]
    host.hear(sent)
    topics = ["/".join(each.topic.split("/")[2::2]) for each in sent]
    assert topics.count("DBIRTH/arm") == 2 and len(topics) == 6 + 2 + 1, "it is born once for a back-fill"
    host.hear(node.row(row(9, {"meter.count": 3.0}), False, T))
    host.hear(node.row(row(10, {"meter.count": 4.0}), False, T))
    assert host.alive == {"meter"}


Sessions.TestCase.settings = settings(max_examples=60, stateful_step_count=60, deadline=None)
TestSessions = Sessions.TestCase


@pytest.mark.parametrize("wrong", [b"", b"{", b"[]", b'{"online": 1, "timestamp": 2}', b'{"online": true}', b"\xff"])
def test_a_state_that_is_none_changes_nothing(wrong: bytes) -> None:
    node = EdgeNode(SparkplugSettings(primary_host="h"), "site", "cell", AlarmBook())
    node.connect()
    with pytest.raises(ProtocolError):
        node.heard("spBv1.0/STATE/h", wrong, True)
    assert not node.ready
    assert node.heard("spBv1.0/STATE/other", b'{"online": true, "timestamp": 5}', True) == ()
    assert not node.ready


def test_names_that_topics_cannot_hold_are_escaped() -> None:
    node = EdgeNode(SparkplugSettings(), "plant/1", "a+b#c", AlarmBook())
    assert node.connect().topic == "spBv1.0/plant%2F1/NDEATH/a%2Bb%23c"


def test_results_have_units_and_their_own_time() -> None:
    node, host = born()
    host.hear(node.result(Task("arm", "task_2", "s", "v", 0.5, T, T + 10**9, (1, 2), 8), False, T + 2 * 10**9))
    assert host.values["", "arm/task/repetition"] == 8
    assert host.values["", "arm/task/end"] == (T + 10**9) // MS


def test_a_birth_tells_how_many_alarms_are_active_now() -> None:
    alarms, host = AlarmBook(), Host()
    node = EdgeNode(SparkplugSettings(group="g", node="n"), "site", "cell", alarms)
    alarms.take(Alarm("1", "joint_fault", "warning", True, T, T, "Joint 3 is stiff."))
    host.connected(node.connect())
    host.hear(node.birth(T))
    assert host.values["", "alarms/active"] == 1


def test_a_text_that_is_not_utf_8_is_no_command():
    told = encode([metric(DataType.BOOLEAN, True, 5, name="Node Control/Rebirth")], 5, None)
    with pytest.raises(ProtocolError, match="not UTF-8"):
        decode(told.replace(b"Node", b"\xff\xfeod"))
