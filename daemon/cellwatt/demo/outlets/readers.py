"""Clients of the three outlets: each reads the demo's cell as any other client would, until it is cancelled."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final

import aiohttp
import aiomqtt
from asyncua import Client, ua

from cellwatt.demo.outlets.said import CURRENT, POWER, SOURCE, Said, is_fault

AGAIN: Final = 0.5
"""s until Prometheus is asked again, and until a lost connection is tried again."""
_PUBLISHING: Final = 100
"""ms between two notifications of OPC UA."""
_QUEUE: Final = 64
"""Values of a node that the OPC UA server keeps between two notifications."""
_TOPIC: Final = "cellwatt/demo/demo"
_SPACE: Final = "urn:cellwatt:demo:demo"
_ALERT: Final = "CellwattAlarm"
_METRICS: Final = (
    "cellwatt_power_watts",
    "cellwatt_state",
    "cellwatt_samples_received_total",
    "cellwatt_alarms_active",
    "ALERTS",
)

Series = Sequence[Mapping[str, Any]]
"""Answer of Prometheus to a query: series with ``metric``, its labels, and ``value``, time and text."""


async def read_prometheus(said: Said, address: str) -> None:
    """Ask Prometheus for all metrics of one scrape at once, again and again."""
    query = {"query": f'{{__name__=~"{"|".join(_METRICS)}"}}'}
    patience = aiohttp.ClientTimeout(total=10)
    async with aiohttp.ClientSession(f"http://{address}", timeout=patience) as session:
        while True:
            try:
                async with session.get("/api/v1/query", params=query, raise_for_status=True) as answer:
                    take_series(said, (await answer.json())["data"]["result"])
            except (aiohttp.ClientError, TimeoutError) as error:
                said.problem = f"does not answer: {str(error) or type(error).__name__}"
            await asyncio.sleep(AGAIN)


def take_series(said: Said, series: Series) -> None:
    """Take one scrape."""
    power = _valued(series, "cellwatt_power_watts", channel=POWER)
    samples = _valued(series, "cellwatt_samples_received_total", source=SOURCE)
    colours = [labels["state"] for labels, value in _valued(series, "cellwatt_state") if value]
    alarms = _valued(series, "cellwatt_alarms_active")
    if not (power and samples and colours):
        said.problem = "has no values of the cell from its last scrape"
        return
    said.problem = ""
    said.frame({POWER: power[0][1]})
    said.state(colours[0], samples[0][1], sum(value for _, value in alarms))
    up = any(is_fault(labels["kind"]) and value for labels, value in alarms)
    alert = [labels["alertstate"] for labels, _ in _valued(series, "ALERTS", alertname=_ALERT)]
    told = {"pending": " is pending (it fires after 1 min)", "firing": " fires"}.get("".join(alert[:1]), " will come")
    said.alarm(f"alert {_ALERT}{told}; cellwatt_alarms_active is 1" if up else "")


def _valued(series: Series, name: str, **labels: str) -> list[tuple[Mapping[str, str], float]]:
    """Labels and values of a metric's series that have these labels."""
    wanted = {"__name__": name, **labels}
    return [(one["metric"], float(one["value"][1])) for one in series if wanted.items() <= one["metric"].items()]


async def read_mqtt(said: Said, address: str) -> None:
    """Subscribe to all topics of the cell; connect again where the connection is lost."""
    host, _, port = address.rpartition(":")
    while True:
        try:
            async with aiomqtt.Client(host, int(port), protocol=aiomqtt.ProtocolVersion.V5) as client:
                await client.subscribe(f"{_TOPIC}/#", 1)
                said.problem = "has not told a frame yet"
                async for message in client.messages:
                    payload = message.payload
                    take_message(said, str(message.topic), payload if isinstance(payload, bytes) else b"")
        except aiomqtt.MqttError as error:
            said.problem = f"the broker does not answer: {error}"
        await asyncio.sleep(AGAIN)


def take_message(said: Said, topic: str, payload: bytes) -> None:
    """Take one message of the cell."""
    match topic.removeprefix(f"{_TOPIC}/").split("/"):
        case ["frame"]:
            row = json.loads(payload)
            if {POWER, CURRENT} <= row["values"].keys():
                said.frame({name: row["values"][name] for name in (POWER, CURRENT)}, row["time"])
                said.problem = ""
        case ["health"]:
            said.health(payload)
        case ["alarm", _, kind, _] if is_fault(kind):
            up = payload and json.loads(payload)["active"]
            said.alarm(f"kept by the broker on …{topic.removeprefix(_TOPIC)}" if up else "")


async def read_opc_ua(said: Said, url: str) -> None:
    """Subscribe to values, health and alarms; connect again where the connection is lost."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # what goes wrong is told in the table
    while True:
        try:
            async with Client(url) as client:
                await _subscribe(said, client)
                while True:
                    await asyncio.sleep(AGAIN)
                    await client.check_connection()
        except (ua.UaError, OSError, TimeoutError) as error:
            said.problem = f"the server does not answer: {str(error) or type(error).__name__}"
        await asyncio.sleep(AGAIN)


async def _subscribe(said: Said, client: Client) -> None:
    space = await client.get_namespace_index(_SPACE)
    nodes = {name: client.get_node(ua.NodeId(name, space)) for name in (POWER, CURRENT, "Health")}
    for node in nodes.values():
        await node.read_data_value(raise_on_bad_status=False)  # those of the channels come with the first frames
    subscription = await client.create_subscription(_PUBLISHING, Notified(said, {n: k for k, n in nodes.items()}))
    await subscription.subscribe_alarms_and_conditions(evtypes=ua.ObjectIds.AlarmConditionType)
    await subscription.subscribe_data_change(list(nodes.values()), queuesize=_QUEUE)


class Notified:
    """Takes what a subscription notifies of; ``nodes`` are the names of its nodes."""

    def __init__(self, said: Said, nodes: Mapping[Any, str]) -> None:
        self._said, self._nodes = said, nodes
        self._begun: dict[datetime, dict[str, float]] = {}
        """Values of the frames of which not all have come."""

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """Take a value; those of one time are a frame."""
        if value is None:
            return
        name = self._nodes[node]
        if name == "Health":
            self._said.health(value)
            return
        at: datetime = data.monitored_item.Value.SourceTimestamp
        frame = self._begun.setdefault(at, {})
        frame[name] = value
        if len(frame) == len((POWER, CURRENT)):
            self._said.frame(frame, round(at.timestamp() * 1e6) * 1000)
            self._said.problem = ""
            del self._begun[at]
        while len(self._begun) > _QUEUE:
            del self._begun[next(iter(self._begun))]

    def event_notification(self, event: Any) -> None:
        """Take the state of a condition."""
        kind = str(getattr(event, "ConditionName", ""))
        if is_fault(kind):
            up = getattr(event, "ActiveState/Id")
            self._said.alarm(f"condition {kind}, severity {event.Severity}: {event.Message.Text}" if up else "")
