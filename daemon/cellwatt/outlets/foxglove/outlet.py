"""The Foxglove library's channels and its WebSocket server, which runs in its own threads."""

from __future__ import annotations

import logging
import math
import re
import time
from collections import Counter
from collections.abc import Iterable
from queue import SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final

from cellwatt.errors import ConfigError, OutletError
from cellwatt.outlets.foxglove.topics import Moment, Outgoing, Topic

if TYPE_CHECKING:
    import foxglove

log = logging.getLogger(__name__)

BACKLOG: Final = 1024
"""Largest number of messages that wait for one client, about 10 s of a cell; further ones replace the oldest."""
_QUIET: Final = 1.0
"""Time, s, without a frame after which the times of results and health set the app's clock."""
_BEHIND: Final = re.compile(r"outbox for client (\S+) full")
_LIBRARY: Final = logging.getLogger("foxglove")


def library() -> Any:
    """Import the Foxglove library. Raises ``ConfigError`` with the extra to install."""
    try:
        import foxglove
        import foxglove.websocket
    except ImportError as error:
        raise ConfigError("Foxglove needs the extra 'foxglove': pip install 'cellwatt[foxglove]'") from error
    return foxglove


def _channel(context: foxglove.Context, topic: Topic) -> foxglove.Channel:
    fox = library()
    schema = fox.Schema(name=topic.schema_name, encoding=topic.schema_encoding, data=topic.schema)
    made: foxglove.Channel = fox.Channel(topic.name, schema=schema, message_encoding=topic.encoding, context=context)
    return made


_RELEASE: Final = 5.0
"""Longest time, s, until the operating system releases the port of the stopped server."""


class _Behind(logging.Handler):
    """Counts the library's notices that a client is too slow; the library does not report the messages it drops."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.notices: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        if found := _BEHIND.search(record.getMessage()):
            self.notices[found[1]] += 1
            log.warning("Foxglove client %s is too slow: its oldest messages are dropped", found[1])


class FoxgloveOutlet:
    """A server on ``host`` and ``port`` (0: a free one), for use with ``with``; it listens after ``open``.

    The library may miss a client that subscribes at once to a topic created while it serves, and may hang if a topic
    is closed while it serves. So a new topic, or one with other fields, restarts the server, and the apps reconnect.
    """

    def __init__(self, name: str, host: str, port: int, topics: Iterable[Topic]) -> None:
        self.port = port
        self.sent: Counter[str] = Counter()
        self._name, self._host = name, host
        self._topics = {topic.name: topic for topic in topics}
        self._asked: SimpleQueue[str] = SimpleQueue()
        """Topics to which clients have subscribed."""
        self._behind = _Behind()
        self.behind = self._behind.notices
        """Number of the library's notices of dropped messages, by client; at most one in 30 s."""
        self._states: dict[tuple[str, str], Outgoing] = {}
        self._clock_time = 0
        self._framed = -math.inf
        self._context: foxglove.Context | None = None  # a reference: the channels live as long as their context
        self._channels: dict[str, foxglove.Channel] | None = None

    def __enter__(self) -> FoxgloveOutlet:
        _LIBRARY.addHandler(self._behind)
        _LIBRARY.setLevel(logging.INFO)
        _LIBRARY.propagate = False  # it logs each client that connects or disconnects
        library().set_log_level(logging.INFO)
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._shut()
        _LIBRARY.removeHandler(self._behind)

    @property
    def is_open(self) -> bool:
        """True if the server listens."""
        return self._channels is not None

    def knows(self, topic: str) -> bool:
        """True if there is a topic of this name."""
        return topic in self._topics

    def open(self) -> None:
        """Start to listen. Raises ``OutletError`` if the port is in use."""
        fox = library()
        context = self._context = fox.Context()
        channels = {topic.name: _channel(context, topic) for topic in self._topics.values()}
        try:
            self._server = fox.start_server(
                name=self._name,
                host=self._host,
                port=self.port,
                capabilities=[fox.websocket.Capability.Time],
                server_listener=self,
                context=context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            for channel in channels.values():
                channel.close()
            raise OutletError(f"Foxglove cannot listen on {self._host}:{self.port}: {error}") from None
        self._channels = channels
        self.port = self._server.port

    def on_subscribe(self, _client: object, channel: Any) -> None:
        """Store the topic to which a client subscribes; called in threads of the library."""
        self._asked.put(channel.topic)

    def on_unsubscribe(self, _client: object, _channel: object) -> None:
        """Called by the library; does nothing."""

    def send(self, moment: Moment) -> None:
        """Send the time and the messages of a moment to all clients that subscribed; never waits.

        Raises ``OutletError`` if the server must restart and its port is in use.
        """
        self._renew(moment.messages)
        for outgoing in moment.messages:
            if outgoing.key is not None:
                self._states[outgoing.topic.name, outgoing.key] = outgoing
            if outgoing.over:
                del self._states[outgoing.topic.name, outgoing.key or ""]
        if self._channels is None:
            return
        self._clock(moment)
        self._log(moment.messages)

    def welcome(self) -> None:
        """Send the current states on the topics to which clients subscribed since the last call."""
        asked = {self._asked.get() for _ in range(self._asked.qsize())}
        self._log(outgoing for (topic, _), outgoing in self._states.items() if topic in asked)

    def _log(self, messages: Iterable[Outgoing]) -> None:
        """Pass messages to the library; never waits."""
        for outgoing in messages:
            if self._channels is not None:
                self._channels[outgoing.topic.name].log(outgoing.data, log_time=outgoing.time)
                self.sent[outgoing.topic.name] += 1

    def _clock(self, moment: Moment) -> None:
        now = time.monotonic()
        framed = moment.after > 0
        self._framed = now if framed else self._framed
        # If the clock goes back, the app treats it as a jump and clears its plots. Frames are later than other
        # messages, so while frames arrive, only they set the clock.
        if moment.time > self._clock_time and (framed or now - self._framed > _QUIET):
            self._clock_time = moment.time
            self._server.broadcast_time(moment.time)

    def _renew(self, messages: Iterable[Outgoing]) -> None:
        new = [
            o.topic for o in messages if (known := self._topics.get(o.topic.name)) is not o.topic and known != o.topic
        ]
        if not new:
            return
        self._topics |= {topic.name: topic for topic in new}
        if self.is_open:
            self._shut()
            self._open_again()

    def _open_again(self) -> None:
        """Listen on the same port again; the library may release it only some time after its server has stopped."""
        end = time.monotonic() + _RELEASE
        while True:
            try:
                return self.open()
            except OutletError:
                if time.monotonic() > end:
                    raise
            time.sleep(0.02)

    def _shut(self) -> None:
        if self._channels is not None:
            self._server.stop()  # before the channels: closing them while it serves may hang
            for channel in self._channels.values():
                channel.close()
            self._channels = None
