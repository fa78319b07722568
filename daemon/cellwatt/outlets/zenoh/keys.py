"""Key expressions of a cell on the bus. Pure.

    cellwatt/<site>/<cell>/<topic>             live messages; liveliness token at cellwatt/<site>/<cell>
    cellwatt/<site>/<cell>/@/<name>            questions
    cellwatt/<site>/<cell>/@/daemon/<pc>/<session>    liveliness token of one daemon

Each topic has one numbering: ``raw/<source>/<stream>``, ``frame``, ``interval``, ``task``, ``energy``,
``prediction/<model>``, ``alarm``, ``event``, ``health``. An alarm's key has ``/<severity>/<kind>`` after its topic.
Names are escaped as in URLs, so that any name gives a valid key.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final
from urllib.parse import unquote

from cellwatt.errors import ConfigError, ProtocolError

PREFIX: Final = "cellwatt"
FRAME: Final = "frame"
ALARM: Final = "alarm"
EVENT: Final = "event"
HEALTH: Final = "health"
KINDS: Final = ("raw", FRAME, "interval", "task", "energy", "prediction", ALARM, EVENT, HEALTH)
"""First chunk of every topic."""

_LONGEST_TOPIC: Final = 1000

TOPICS: Final = "raw/SOURCE/STREAM, frame, interval, task, energy, prediction/MODEL, alarm, event, health"
"""Forms of topics, for messages."""
_NAMES: Final = {"raw": 2, "prediction": 1}
_UNSAFE = re.compile(r"[/*$?#%\s\x00-\x1f\x7f]|^@")


def escape(name: str) -> str:
    """A name as one chunk of a key: ``/ * $ ? # %``, blanks and a leading ``@`` become ``%XX``.

    Raises ``ConfigError`` for an empty name.
    """
    if not name:
        raise ConfigError("an empty name cannot be part of a Zenoh key")
    return _UNSAFE.sub(lambda found: "".join(f"%{byte:02X}" for byte in found[0].encode()), name)


@lru_cache(maxsize=1024)
def raw_topic(source: str, stream: str) -> str:
    """Topic of the raw samples of a stream."""
    return f"raw/{escape(source)}/{escape(stream)}"


def topic_of_series(series: str) -> str:
    """Topic of the results or events of a series, see ``results.series_of``."""
    kind, _, model = series.partition("/")
    return f"{kind}/{escape(model)}" if model else kind


def series_of_topic(topic: str) -> str:
    """The series of a topic."""
    return unquote(topic)


def alarm_path(severity: str, kind: str, alarm: str | None = None) -> str:
    """An alarm's key within its cell; with ``alarm``, the alarm's id, unique among alarms of one kind."""
    path = f"{ALARM}/{escape(severity)}/{escape(kind)}"
    return path if alarm is None else f"{path}/{escape(alarm)}"


@dataclass(frozen=True, slots=True)
class CellKeys:
    """Keys of one cell. Raises ``ConfigError`` when a name is empty."""

    site: str
    cell: str

    def __post_init__(self) -> None:
        escape(self.site), escape(self.cell)

    @property
    def root(self) -> str:
        """Key of the cell and of its liveliness token."""
        return f"{PREFIX}/{escape(self.site)}/{escape(self.cell)}"

    def live(self, path: str) -> str:
        """Key of the live messages of a topic, or of an alarm's path."""
        return f"{self.root}/{path}"

    def question(self, name: str) -> str:
        """Key of a question, such as ``status``; see ``answers``."""
        return f"{self.root}/@/{name}"

    def daemon(self, pc: str, session: int) -> str:
        """Key of the liveliness token of a daemon."""
        return f"{self.root}/@/daemon/{escape(pc)}/{session}"

    @property
    def daemons(self) -> str:
        """Keys of all daemons that publish as this cell."""
        return f"{self.root}/@/daemon/*/*"


@dataclass(frozen=True)
class Address:
    """A parsed key: ``names`` are the unescaped chunks after the kind (``("arm", "main")`` for a raw stream)."""

    site: str
    cell: str
    kind: str
    names: tuple[str, ...] = ()

    @cached_property
    def topic(self) -> str:
        """The topic, escaped as in keys."""
        return "/".join([self.kind, *(escape(n) for n in self.names[: _NAMES.get(self.kind, 0)])])


@lru_cache(maxsize=1024)
def parse(key: str) -> Address:
    """Parse a message's key. Raises ``ProtocolError`` for keys that no cell uses."""
    chunks = key.split("/")
    head, path = chunks[:3], chunks[3:]
    known = len(head) == 3 and head[0] == PREFIX and bool(path) and path[0] in KINDS
    if not known or "" in chunks or not _right_length(path):
        raise ProtocolError(f"{key!r} is not a key of a cellwatt cell")
    return Address(unquote(head[1]), unquote(head[2]), path[0], tuple(map(unquote, path[1:])))


def is_topic(text: str) -> bool:
    """True if a text is a topic, escaped as in keys."""
    try:
        return len(text) < _LONGEST_TOPIC and parse(f"{PREFIX}/-/-/{text}").topic == text
    except ProtocolError:
        return False


def is_wanted(text: str) -> bool:
    """True if a text is a topic or a prefix of topics, such as ``raw/arm``."""
    kind, *names = text.split("/")
    return kind in KINDS and len(names) <= _NAMES.get(kind, 0) and all(names)


def _right_length(path: list[str]) -> bool:
    if path[0] == ALARM:
        return len(path) in (1, 3, 4)
    return len(path) == 1 + _NAMES.get(path[0], 0)
