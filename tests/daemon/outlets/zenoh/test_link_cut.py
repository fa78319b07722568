"""A link that is cut loses nothing and duplicates nothing: cell, router and consumer as processes of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.daemon.outlets.zenoh.fake_cell import EPOCH
from tests.daemon.outlets.zenoh.processes import Child, Link, free_port
from tests.patience import wait_until

RATE, BLOCK = 500.0, 5


def stream(seconds: float) -> dict[str, Any]:
    return {"samples": int(RATE * seconds), "frames_too": True, "every": 10, "rate": RATE, "block": BLOCK}


def received(consumer: Child, topic: str) -> list[dict[str, Any]]:
    return [s for s in list(consumer.said) if isinstance(s, dict) and s.get("topic") == topic]


def reached(consumer: Child, topic: str, end: int) -> bool:
    messages = received(consumer, topic)
    return bool(messages) and messages[-1]["first"] + messages[-1]["count"] >= end


def assert_complete(messages: list[dict[str, Any]], begin: int, end: int) -> None:
    """Every number from begin to end once, in order, with the values that belong to it."""
    following = begin
    for message in messages:
        assert message["first"] == following, message
        assert "gap" not in message
        assert message.get("as_offered", True)
        if "values" in message:
            numbers = range(message["first"], message["first"] + message["count"])
            offset = 0.25 if message["topic"] == "frame" else 0.0
            assert message["values"] == [n + offset for n in numbers]
        following += message["count"]
    assert following == end


def publish(cell: Child, seconds: float, begin: float = 0.0) -> None:
    """Publish from ``begin`` on, and be done with it."""
    cell.send(stream=stream(seconds))
    published(cell, begin + seconds)


def published(cell: Child, seconds: float) -> dict[str, int]:
    """What is published once so many seconds of samples are."""
    end = int(RATE * seconds)
    return cell.wait_for(lambda s: "published" in s and s["published"]["samples"] == end, "published")["published"]


def check_all(cell: Child, consumer: Child, seconds: float) -> dict[str, int]:
    """Wait for the end of what was published and compare; gives what the consumer counted."""
    end = published(cell, seconds)
    ends = {"raw/arm/samples": "samples", "frame": "frames", "alarm": "alarms"}
    for topic, name in ends.items():
        wait_until(lambda t=topic, n=name: reached(consumer, t, end[n]), f"all of {topic}")
        assert_complete(received(consumer, topic), 0, end[name])
    assert consumer.finish() == 0
    # not the last it said: a message may still come while it closes
    counts = next(s["counts"] for s in consumer.said if isinstance(s, dict) and "counts" in s)
    assert counts.get("lost", 0) == 0
    return counts


def start_consumer(port: int, **more: Any) -> Child:
    return joined(Child("consumer_process", mode="client", connect=[f"tcp/127.0.0.1:{port}"], **more).ready())


def joined(consumer: Child) -> Child:
    """A consumer, once it knows where its cell is."""
    consumer.wait_for(lambda s: isinstance(s, dict) and s.get("topic") == "health" and s["joined"], "the cell's word")
    return consumer


def test_cut_beside_a_router() -> None:
    port = free_port()
    with Child("router_process", listen=[f"tcp/127.0.0.1:{port}"]) as router, Link(port) as link:
        router.ready()
        with Child("cell_process", mode="client", connect=[f"tcp/127.0.0.1:{link.port}"]) as publisher:
            publisher.ready()
            with start_consumer(port) as consumer:
                publish(publisher, 1.0)
                wait_until(lambda: reached(consumer, "raw/arm/samples", 250), "half a second of data")
                link.cut()
                publish(publisher, 1.0, begin=1.0)
                link.restore()
                publish(publisher, 0.5, begin=2.0)
                counts = check_all(publisher, consumer, 2.5)
                assert counts["backfilled"] >= RATE / 2
            assert publisher.finish() == 0 and publisher.said[-1]["account"]["residue"] == 0
        assert router.finish() == 0


def test_restarts_while_the_link_is_cut() -> None:
    """Of a session that began and ended during the cut nothing was ever heard; its recordings tell of it."""
    port = free_port()
    listen = {"listen": [f"tcp/127.0.0.1:{port}"]}
    between, last = EPOCH + 10**9, EPOCH + 2 * 10**9
    with Child("cell_process", **listen) as first, Link(port) as link, start_consumer(link.port) as consumer:
        first.ready().send(stream=stream(0.2))
        wait_until(lambda: reached(consumer, "raw/arm/samples", 100), "the first session")
        link.cut()
        first.kill()
        recorded = {str(EPOCH): 130, str(between): 90}
        with Child("cell_process", session=last, recorded=recorded, **listen) as second:
            second.ready().send(stream=stream(0.2))
            second.wait_for(lambda s: "published" in s, "published")
            link.restore()
            new = lambda: [m for m in received(consumer, "raw/arm/samples") if m["session"] == last]  # noqa: E731
            wait_until(lambda: new() and new()[-1]["first"] + new()[-1]["count"] == 100, "the last session")
    messages = received(consumer, "raw/arm/samples")
    for session, end in ((EPOCH, 130), (between, 90), (last, 100)):
        assert_complete([m for m in messages if m["session"] == session], 0, end)
    assert [m["session"] for m in messages] == sorted(m["session"] for m in messages)


def made_known(cell: Child, count: int, end: int) -> None:
    """Publish and record frames at once, up to number ``end``."""
    cell.send(frames=count)
    cell.wait_for(lambda s: "published" in s and s["published"]["frames"] == end, "frames")


def test_frames_of_a_long_cut_come_from_the_record(tmp_path: Path) -> None:
    port = free_port()
    recording = {"folder": str(tmp_path), "record": {"file_size": "10 kB"}}
    with Child("cell_process", listen=[f"tcp/127.0.0.1:{port}"], **recording) as publisher, Link(port) as link:
        publisher.ready()
        with start_consumer(link.port, want=["frame", "health"]) as consumer:
            made_known(publisher, 50, 50)
            wait_until(lambda: reached(consumer, "frame", 50), "frames before the cut")
            link.cut()
            made_known(publisher, 9000, 9050)
            link.restore()
            made_known(publisher, 50, 9100)
            wait_until(lambda: reached(consumer, "frame", 9100), "all frames")
    assert len(list(tmp_path.glob("*.mcap"))) > 5
    messages = received(consumer, "frame")
    assert_complete(messages, 0, 9100)
    late = [m["count"] for m in messages if m["backfilled"]]
    assert sum(late) >= 9000 > 2000 >= max(late)
