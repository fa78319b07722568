"""4 emulated OPC UA servers with 20 tags at 10 Hz from one event loop, beside asyncua's client in a plain loop.

    python bench/drivers/opc_ua.py

The servers run in a process of their own. Both sides subscribe to the same tags of each server, published every 100 ms;
the plain loop counts what asyncua's own subscriptions hand it, 19 values a sample, as one of the tags never changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from asyncua import Client
from sides import Length, Result, Run, accounts, driven, in_turns, main, measured, served

from cellwatt.emulation import ArmSignals
from cellwatt_drivers.opc_ua import OpcUaDriver, OpcUaSettings
from cellwatt_drivers.opc_ua.emulator import OpcUaEmulator

SERVERS, RATE, CHANGING = 4, 10.0, 19


def devices() -> list[OpcUaEmulator]:
    options = {"rate": f"{RATE:g}"}
    return [OpcUaEmulator(ArmSignals(), "127.0.0.1:0", seed=seed, options=options) for seed in range(SERVERS)]


async def ours(ports: Sequence[int], seconds: float) -> Run:
    common = {"host": "127.0.0.1", "model": "opc_40010", "rate": RATE, "publish": 0.1}
    made = [OpcUaSettings.model_validate(common | {"port": port}) for port in ports]
    async with driven([partial(OpcUaDriver, f"plc_{s.port}", s) for s in made]) as inlets:
        return await measured(accounts(inlets), seconds)


class _Counting:
    """Counts the values of all servers."""

    def __init__(self) -> None:
        self.values = 0

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        self.values += 1


async def plain(ports: Sequence[int], seconds: float) -> Run:
    counting = _Counting()
    clients = [Client(f"opc.tcp://127.0.0.1:{port}") for port in ports]
    try:
        for client in clients:
            await client.connect()
            subscription = await client.create_subscription(100, counting)
            nodes = [client.get_node(id_) for id_ in await _variables(client)]
            await subscription.subscribe_data_change(nodes, queuesize=40)
        return await measured(lambda: (counting.values // CHANGING, 0), seconds)
    finally:
        for client in clients:
            await client.disconnect()


async def _variables(client: Client) -> list[Any]:
    """The variables below DeviceSet that the map of OPC 40010-1 names."""
    from asyncua import ua

    waiting, found = [await client.nodes.objects.get_child("2:DeviceSet")], []
    while waiting:
        for child in await waiting.pop().get_children():
            if await child.read_node_class() == ua.NodeClass.Variable:
                found.append(child.nodeid)
            else:
                waiting.append(child)
    return found


async def bench(length: Length) -> Result:
    """Both sides in turns against the same servers."""
    async with served(__file__) as addresses:
        ports = [int(address.rpartition(":")[2]) for address in addresses]
        both = await in_turns(partial(ours, ports), partial(plain, ports), length)
    return Result(SERVERS, RATE, length.seconds, length.repeats, "asyncua", *both)


if __name__ == "__main__":
    main(bench, devices)
