"""Answers that are not the controller's: what is refused, and that health says what somebody tried."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import pairwise

import pytest

from cellwatt_drivers.yaskawa import wire
from cellwatt_drivers.yaskawa.link import Exchange, Link, open_link
from tests.patience import eventually

from .rig import Inlet

REQUEST = wire.Request(wire.TORQUE)
GENUINE, FORGED = bytes(32), b"\x01" + bytes(31)

Answers = Callable[[int], list[wire.Answer]]


def answer(number: int, data: bytes = GENUINE) -> wire.Answer:
    return wire.Answer(number, wire.GET_ALL | wire.ANSWER, 0, 0, data)


class Controller(asyncio.DatagramProtocol):
    """Answers each request with what ``answers`` says for its number, in that order."""

    def __init__(self, answers: Answers) -> None:
        self.answers = answers
        self.numbers: list[int] = []

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        _, number = wire.decode_request(data)
        self.client = addr
        self.numbers.append(number)
        for each in self.answers(number):
            self.transport.sendto(wire.encode_answer(each), addr)


@asynccontextmanager
async def linked(answers: Answers) -> AsyncIterator[tuple[Controller, Link, Inlet]]:
    loop = asyncio.get_running_loop()
    transport, controller = await loop.create_datagram_endpoint(
        lambda: Controller(answers), local_addr=("127.0.0.1", 0)
    )
    inlet = Inlet()
    try:
        async with open_link("127.0.0.1", transport.get_extra_info("sockname")[1], 5.0, inlet) as link:  # type: ignore[arg-type]
            yield controller, link, inlet
    finally:
        transport.close()


async def ask(link: Link) -> Exchange:
    return await link.ask(REQUEST, 0)


async def test_the_number_of_the_next_request_cannot_be_guessed() -> None:
    async with linked(lambda number: [answer(number)]) as (controller, link, _):
        for _ in range(600):
            await ask(link)
    numbers = controller.numbers
    steps = {(b - a) % 256 for a, b in pairwise(numbers)}
    assert len(steps) > 100
    assert all(len(set(numbers[i : i + 128])) == 128 for i in range(len(numbers) - 128)), "an answer may still come"


async def test_an_answer_that_contradicts_another_is_told_as_forged() -> None:
    async with linked(lambda number: [answer(number, FORGED), answer(number)]) as (_, link, inlet):
        for _ in range(20):
            await ask(link)
        await eventually(lambda: inlet.account.counters["contradicting answers"] == 20)
    assert inlet.account.forgeries == {"contradicting answers"}
    assert not inlet.account.counters["duplicates"]


async def test_the_same_answer_again_is_a_duplicate() -> None:
    async with linked(lambda number: [answer(number)] * 50) as (_, link, inlet):
        for _ in range(20):
            await ask(link)
        await eventually(lambda: inlet.account.counters["duplicates"] == 20 * 49)
    assert inlet.account.anomalies == {"duplicates"} and not inlet.account.forgeries


@pytest.mark.parametrize("position", [0, 4, 12])
async def test_reserved_fields_that_change_are_not_the_controllers(position: int) -> None:
    def answers(number: int) -> list[wire.Answer]:
        if len(controller.numbers) == 1:
            return [answer(number)]
        strange = bytearray(wire.CONSTANTS)
        strange[position] ^= 1
        return [replace(answer(number, FORGED), constants=bytes(strange)), answer(number)]

    async with linked(answers) as (controller, link, inlet):
        for _ in range(5):
            assert (await ask(link)).answer.data == GENUINE
    assert inlet.account.counters["malformed"] == 4


async def test_a_controller_with_reserves_of_its_own_is_read() -> None:
    own = bytes(len(wire.CONSTANTS))
    async with linked(lambda number: [replace(answer(number), constants=own)]) as (_, link, inlet):
        for _ in range(5):
            await ask(link)
    assert not inlet.account.counters


async def test_what_comes_from_another_port_is_never_seen() -> None:
    async with linked(lambda _: []) as (controller, link, inlet):
        asking = asyncio.ensure_future(ask(link))
        await eventually(lambda: controller.numbers)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.setblocking(False)
            stranger.bind(("127.0.0.1", 0))
            for number in range(256):
                stranger.sendto(wire.encode_answer(answer(number, FORGED)), controller.client)
        controller.transport.sendto(wire.encode_answer(answer(controller.numbers[0])), controller.client)
        assert (await asking).answer.data == GENUINE
    assert not inlet.account.counters
