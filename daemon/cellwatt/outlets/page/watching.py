"""Feeds a page from the bus: follows one cell as any subscriber does."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Final

from cellwatt.errors import OutletError
from cellwatt.outlets.page.feed import Feed
from cellwatt.subscriber import LinkSettings, Subscriber

log = logging.getLogger(__name__)

WANT: Final = ("frame", "interval", "task", "energy", "prediction", "alarm", "event", "health")
"""Topics that a page shows."""
UNREADABLE: Final = (KeyError, TypeError, ValueError, AttributeError)
"""What a message of another version of cellwatt, or of somebody who speaks in a cell's name, may raise."""
PAUSE: Final = 2.0
"""s before a link that failed is tried again."""


async def watch(link: LinkSettings, feed: Feed, verify: Path | None = None) -> None:
    """Give a feed all that its cell publishes, until cancelled; a link that fails is told to browsers and tried again.

    ``verify`` is the public key of a cell that signs.
    """
    unreadable = 0
    while True:
        try:
            async with Subscriber(feed.site, feed.cell, link, want=WANT, verify=verify) as subscriber:
                async for message in subscriber:
                    try:
                        feed.take(message)
                    except UNREADABLE as error:
                        unreadable += 1
                        if unreadable == 1:
                            log.warning("%s/%s: a message cannot be shown: %r", feed.site, feed.cell, error)
        except OutletError as error:
            log.warning("%s/%s: %s; trying again", feed.site, feed.cell, error)
            feed.take_gap(f"the link to the cell failed: {error}")
        await asyncio.sleep(PAUSE)
