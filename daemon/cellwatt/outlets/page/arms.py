"""The shapes of a cell's arms, read as soon as its channels are known."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from cellwatt.errors import CellwattError
from cellwatt.outlets.page.archive import Desk
from cellwatt.outlets.page.feed import Feed

log = logging.getLogger(__name__)


async def follow(feed: Feed, arms: Mapping[str, Path], desk: Desk) -> None:
    """Keep the arms of a feed for its channels, until cancelled; one that cannot be read is left out and logged."""
    while arms:
        await feed.laid_out.wait()
        feed.laid_out.clear()
        from cellwatt.outlets.page.skeleton import skeleton

        found = []
        for source, file in arms.items():
            try:
                found.append(await desk.ask(skeleton, source, file, feed.names))
            except (CellwattError, OSError, ValueError) as error:
                log.warning("the arm of %s is not shown: %s: %s", source, file, error)
        if found != feed.arms:
            feed.arms = found
            feed.hub.end()
