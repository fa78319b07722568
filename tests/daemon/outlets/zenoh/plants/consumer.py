"""Consumers at headquarters as processes; each says ten times a second what it has.

    python -m PACKAGE.consumer '{"site", "cell", "link": settings, "how": "recorder" | "board"}'

``recorder`` is a ``Subscriber``: every sample once, in order. It compares each with its number, which is its first
value. ``board`` counts the blocks of samples that come live.
"""

from __future__ import annotations

import json
import sys
import threading
from collections import Counter, defaultdict
from typing import Any

import numpy as np

from cellwatt import Batch, Frames
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.subscriber import Gap, Message, Subscriber
from tests.orders import say


class Recorder:
    """What came of each topic: the next number, and everything that is wrong."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.topics: defaultdict[str, Counter[str]] = defaultdict(lambda: Counter(first=-1))
        self.reasons: Counter[str] = Counter()

    def take(self, message: Message) -> None:
        with self.lock:
            topic = self.topics[message.topic]
            if topic["first"] < 0:
                topic["first"] = topic["next"] = message.sequence
            topic["holes"] += max(message.sequence - topic["next"], 0)
            topic["twice"] += max(topic["next"] - message.sequence, 0)
            topic["next"] = message.sequence + message.count
            content = message.content
            if isinstance(content, Gap):
                topic["lost"] += message.count
                self.reasons[content.reason] += 1
                return
            topic["count"] += message.count
            topic["backfilled"] += message.count * message.backfilled
            if isinstance(content, Batch | Frames):
                due = message.sequence + np.arange(len(content)) + (0.25 if isinstance(content, Frames) else 0.0)
                topic["wrong"] += int(np.count_nonzero(content.values[:, 0] != due))

    def has(self) -> dict[str, Any]:
        with self.lock:
            return {"topics": {name: dict(topic) for name, topic in self.topics.items()}, "reasons": dict(self.reasons)}


def record(order: dict[str, Any]) -> None:
    recorder = Recorder()
    link = LinkSettings(**order["link"])
    with Subscriber(order["site"], order["cell"], link, want=("raw", "frame", "alarm")) as cell:

        def tell() -> None:
            while not over.wait(0.1):
                say({**recorder.has(), "counts": cell.counts})

        over = threading.Event()
        threads = [threading.Thread(target=tell), threading.Thread(target=lambda: (sys.stdin.read(), cell.close()))]
        for thread in threads:
            thread.start()
        say("ready")
        for message in cell:
            recorder.take(message)
        over.set()
        for thread in threads:
            thread.join()


def watch(order: dict[str, Any]) -> None:
    keys, over = CellKeys(order["site"], order["cell"]), threading.Event()
    came: list[object] = []
    with open_session(LinkSettings(**order["link"])) as session:
        session.declare_subscriber(keys.live("raw/**"), came.append)
        say("ready")
        threading.Thread(target=lambda: (sys.stdin.read(), over.set())).start()
        while not over.wait(0.1):
            say({"live": len(came)})


if __name__ == "__main__":
    settings = json.loads(sys.argv[1])
    {"recorder": record, "board": watch}[settings["how"]](settings)
