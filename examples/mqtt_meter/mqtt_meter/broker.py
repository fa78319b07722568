"""As much of an MQTT 3.1.1 broker as a subscriber of one topic needs (OASIS MQTT 3.1.1, sections 2 and 3)."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

CONNECT, PUBLISH, SUBSCRIBE, PINGREQ, DISCONNECT = 1, 3, 8, 12, 14
CONNACK = bytes([0x20, 2, 0, 0])
PINGRESP = bytes([0xD0, 0])


def packet(first: int, body: bytes) -> bytes:
    """A packet: first byte, remaining length in groups of seven bits, body."""
    length, rest = bytearray(), len(body)
    while True:
        rest, group = divmod(rest, 128)
        length.append(group | (0x80 if rest else 0))
        if not rest:
            return bytes([first]) + bytes(length) + body


def publication(topic: str, payload: bytes) -> bytes:
    """A PUBLISH at QoS 0."""
    name = topic.encode()
    return packet(PUBLISH << 4, len(name).to_bytes(2, "big") + name + payload)


async def read_packet(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    """Type and body of the next packet. Raises ``asyncio.IncompleteReadError`` at the end."""
    first = (await reader.readexactly(1))[0]
    length = shift = 0
    while True:
        group = (await reader.readexactly(1))[0]
        length |= (group & 0x7F) << shift
        shift += 7
        if not group & 0x80:
            return first >> 4, await reader.readexactly(length)


@dataclass(eq=False)
class Client:
    """One connection, and what it subscribed to."""

    writer: asyncio.StreamWriter
    topics: set[str] = field(default_factory=set)

    async def serve(self, reader: asyncio.StreamReader) -> None:
        """Answer until it leaves."""
        while True:
            kind, body = await read_packet(reader)
            if kind == CONNECT:
                self.writer.write(CONNACK)
            elif kind == SUBSCRIBE:
                topics = _topics(body[2:])
                self.writer.write(packet(0x90, body[:2] + bytes(len(topics))))
                self.topics.update(topics)
            elif kind == PINGREQ:
                self.writer.write(PINGRESP)
            elif kind == DISCONNECT:
                return


def _topics(body: bytes) -> list[str]:
    found = []
    while body:
        length = int.from_bytes(body[:2], "big")
        found.append(body[2 : 2 + length].decode())
        body = body[3 + length :]
    return found
