"""A client that speaks the Foxglove WebSocket protocol, and keeps what it is told."""

from __future__ import annotations

import asyncio
import base64
import json
import struct
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from tests.patience import eventually

MESSAGE, TIME = 1, 2


@dataclass
class Told:
    """A message: its time in UTC ns, its bytes."""

    time: int
    data: bytes


@dataclass
class Client:
    """Subscribes to every topic that is advertised."""

    port: int
    info: dict[str, Any] = field(default_factory=dict)
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    told: dict[str, list[Told]] = field(default_factory=lambda: defaultdict(list))
    times: list[int] = field(default_factory=list)
    ended: bool = False

    async def __aenter__(self) -> Client:
        await eventually(self._greeted, "a server that greets")
        return self

    async def __aexit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        await self._socket.close()
        await self._reading

    async def _greeted(self) -> bool:
        """Connect; False if nobody listens, or the server ends before its greeting because it starts anew."""
        protocols = [Subprotocol("foxglove.sdk.v1")]
        try:
            self._socket = await connect(f"ws://127.0.0.1:{self.port}", subprotocols=protocols, max_size=None)
        except (OSError, InvalidHandshake):
            return False
        assert self._socket.subprotocol == "foxglove.sdk.v1"
        self.ended = False
        self._reading = asyncio.create_task(self._read())
        await eventually(lambda: self.info or self.ended, "a greeting")
        return bool(self.info)

    async def _read(self) -> None:
        with suppress(ConnectionClosed):  # the library's server says no farewell
            await self._take()
        self.ended = True

    async def _take(self) -> None:
        async for message in self._socket:
            if isinstance(message, str):
                await self._hear(json.loads(message))
            elif message[0] == TIME:
                self.times.append(struct.unpack("<Q", message[1:9])[0])
            elif message[0] == MESSAGE:
                number, time = struct.unpack("<IQ", message[1:13])
                topic = next(t for t, channel in self.channels.items() if channel["id"] == number)
                self.told[topic].append(Told(time, message[13:]))

    async def _hear(self, said: dict[str, Any]) -> None:
        if said["op"] == "serverInfo":
            self.info = said
        elif said["op"] == "advertise":
            wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in said["channels"]]
            self.channels |= {channel["topic"]: channel for channel in said["channels"]}
            await self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def decoded(self, topic: str) -> list[Any]:
        """The messages of a topic, read by nothing but its schema."""
        channel = self.channels[topic]
        if channel["encoding"] == "json":
            return [json.loads(told.data) for told in self.told[topic]]
        read = decoder_of(channel["schemaName"], base64.b64decode(channel["schema"]))
        return [read(told.data) for told in self.told[topic]]


def decoder_of(name: str, schema: bytes) -> Callable[[bytes], Any]:
    """Reads a type of messages that a serialised FileDescriptorSet describes."""
    found = DecoderFactory().decoder_for("protobuf", Schema(id=1, data=schema, encoding="protobuf", name=name))
    assert found is not None
    return found
