"""The conversation over UDP: what a process that is late to it says of the time."""

from __future__ import annotations

import asyncio
import socket

from cellwatt.receipt import stamp_receipts
from cellwatt_drivers.yaskawa import wire
from cellwatt_drivers.yaskawa.link import Link
from tests.drivers.yaskawa.rig import Inlet


def waits(opened: socket.socket) -> bool:
    try:
        return bool(opened.recv(1, socket.MSG_PEEK))
    except BlockingIOError:
        return False


async def answered_late(link: Link, inlet: Inlet, here: socket.socket, controller: socket.socket) -> int:
    """ns by which an answer is stamped after it was there, if it is read 20 ms later."""
    asking = asyncio.create_task(link.ask(wire.Request(wire.STATUS), 0))
    await asyncio.sleep(0)
    datagram, asker = await asyncio.get_running_loop().sock_recvfrom(controller, 2048)
    request, number = wire.decode_request(datagram)
    controller.sendto(wire.encode_answer(wire.Answer(number, request.service | wire.ANSWER, 0, 0)), asker)
    while not waits(here):
        pass
    there = inlet.now()
    while inlet.now() - there < 20_000_000:
        pass
    exchange = await asking
    assert exchange.asked <= exchange.arrival
    return exchange.arrival - there


async def test_a_late_process_does_not_make_the_answer_late():
    inlet, loop = Inlet(), asyncio.get_running_loop()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as controller,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
    ):
        controller.bind(("127.0.0.1", 0))
        controller.setblocking(False)
        here.setblocking(False)
        here.connect(controller.getsockname())
        stamp_receipts(here)
        link = Link(here, "here", 5.0, inlet)
        loop.add_reader(here, link.readable)
        # A process that is interrupted between two readings of the clock adds that time: not each time.
        late = [await answered_late(link, inlet, here, controller) for _ in range(5)]
        loop.remove_reader(here)
    assert min(late) <= 0
