"""A ``Subscriber`` as a process; says each message it is given, with what a test wants to know of its content."""

from __future__ import annotations

import json
import sys
import threading
from typing import Any

from cellwatt import Batch, Frames
from cellwatt.outlets.zenoh.link import LinkSettings
from cellwatt.subscriber import Gap, Message, Subscriber
from tests.blocks import same_frames
from tests.daemon.outlets.zenoh.fake_cell import CELL, SITE, frames
from tests.orders import say


def summary(message: Message) -> dict[str, Any]:
    content = message.content
    about: dict[str, Any] = {"topic": message.topic, "session": message.session, "first": message.sequence}
    about |= {"count": message.count, "backfilled": message.backfilled}
    if isinstance(content, Batch | Frames):
        about["values"] = content.values[:, 0].tolist()
        if isinstance(content, Frames):
            about["as_offered"] = same_frames(content, frames(content.sequence, len(content)))
    elif isinstance(content, Gap):
        about["gap"] = content.reason
    return about


def main() -> None:
    settings = json.loads(sys.argv[1])
    site, want = settings.pop("site", SITE), settings.pop("want", ["raw", "frame", "alarm", "event", "health"])
    with Subscriber(site, CELL, LinkSettings(**settings), want=want) as cell:

        def stop() -> None:
            sys.stdin.read()
            say({"counts": cell.counts})
            cell.close()

        stopper = threading.Thread(target=stop)
        stopper.start()
        say("ready")
        for message in cell:
            say(summary(message) | {"joined": cell._inbox.following.joined})
        stopper.join()


if __name__ == "__main__":
    main()
