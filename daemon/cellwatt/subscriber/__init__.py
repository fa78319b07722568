"""Receives the data of one cell from the bus: each topic in order, each sample exactly once.

    async with Subscriber("plant-1", "weld-3", LinkSettings(mode="client", connect=("tcp/router:7447",))) as cell:
        async for message in cell:
            print(message.topic, message.sequence, message.content)

After an interrupted link, missing messages are requested from the cell's record and delivered, with ``backfilled``
set, before later ones. Messages that the cell no longer has are delivered as a ``Gap``.
"""

from cellwatt.outlets.zenoh.link import LinkSettings
from cellwatt.outlets.zenoh.order import Gap, Message
from cellwatt.outlets.zenoh.received import Health
from cellwatt.subscriber.inbox import EVERYTHING
from cellwatt.subscriber.subscriber import Subscriber

__all__ = ["EVERYTHING", "Gap", "Health", "LinkSettings", "Message", "Subscriber"]
