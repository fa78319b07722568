"""The contract between the daemon and a consumer of its data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pydantic import BaseModel, SecretStr, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from cellwatt.account import Account
from cellwatt.alarms import AlarmBook
from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.results import Event, Result
from cellwatt.section import Section


class OutletSettings(Section):
    """Settings of one outlet; every outlet derives its own."""

    def warnings(self) -> tuple[str, ...]:
        """Warnings about valid settings, one line each, shown by ``check``, ``doctor``, health and the log."""
        return ()


def both_or_neither(**settings: object) -> None:
    """Raise ``ValueError`` if some of these settings are given and others are not."""
    given = [value is not None for value in settings.values()]
    if any(given) and not all(given):
        raise ValueError(f"{' and '.join(settings)} are needed together")


def refusal(settings: BaseModel, *problems: tuple[tuple[str | int, ...], object, str]) -> ValidationError:
    """The error for settings that contradict each other, with the key path, the value and the text of each problem."""
    found = [
        InitErrorDetails(type=PydanticCustomError("value_error", "{error}", {"error": text}), loc=place, input=value)
        for place, value, text in problems
    ]
    return ValidationError.from_exception_data(type(settings).__name__, found, hide_input=True)


def revealed(value: Any) -> Any:
    """Settings including their secrets, JSON-ready. Pass them only to the process that runs the outlet."""
    match value:
        case SecretStr():
            return value.get_secret_value()
        case BaseModel():
            return {name: revealed(getattr(value, name)) for name in type(value).model_fields}
        case Mapping():
            return {name: revealed(inner) for name, inner in value.items()}
        case tuple() | list():
            return [revealed(inner) for inner in value]
        case Path():
            return str(value)
    return value


Item = Batch | Frames | Result | Event
"""Items that are published live."""


class Journal(Protocol):
    """Results and events published in this session, including those from before a restart of this process."""

    def put(self, item: Result | Event) -> int:
        """Add an item; return its number in its series. Adding the last item again returns the same number."""
        ...

    def past(self) -> Iterator[tuple[int, Result | Event]]:
        """The most recent items with their numbers, each series in order."""
        ...


class CellView(Protocol):
    """The running cell as an outlet sees it.

    Methods may be called from any thread; ``acknowledge``, ``shelve`` and ``unshelve`` on the event loop only.
    """

    site: str
    cell: str
    folder: Path
    """Folder to which relative paths in the settings refer."""
    record_folder: Path | None
    """Folder of the recordings; ``None`` if the cell records nothing."""
    session: int
    """Start of this daemon, UTC ns. A sequence number is unique together with the session."""
    journal: Journal | None
    """Items published so far, numbered from the start of ``session``.

    ``None`` if the publishing process cannot restart within a session.
    """
    alarms: AlarmBook
    """Active alarms with their acknowledgements and shelving. Read only, on the event loop only."""

    def status(self) -> Mapping[str, Any]:
        """Health of every source, stage and outlet with its figures, JSON-ready."""
        ...

    def config(self) -> Mapping[str, Any]:
        """The settings in force, secrets blanked, JSON-ready."""
        ...

    def schema(self) -> Mapping[str, Any]:
        """Streams and frame columns: names, units, kinds, rates, methods, JSON-ready."""
        ...

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        """Stored recordings: file, start, end, bytes, state, JSON-ready."""
        ...

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        """Recorded samples ``first`` … ``first + count`` of a stream that are still stored, in order.

        If none of them is stored, the first ``count`` samples stored after them.
        """
        ...

    def frame_history(self, session: int, first: int, count: int) -> Sequence[Frames]:
        """Recorded frames ``first`` … ``first + count`` that are still stored, in order, with their original numbers.

        If none of them is stored, the first ``count`` frames stored after them.
        """
        ...

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        """Recorded results or events ``first`` … ``first + count`` of a series that are still stored, with numbers.

        If none of them is stored, the first ``count`` stored after them. Alarms have no numbers in the record.
        """
        ...

    def acknowledge(self, alarm_id: str, name: str, note: str) -> None:
        """Acknowledge an alarm for a person. Raises ``CellwattError`` if it is not active or ``name`` is empty."""
        ...

    def shelve(self, alarm_id: str, until: int, name: str, note: str) -> None:
        """Suppress an alarm until ``until``, UTC ns, unless its severity rises.

        Raises ``CellwattError`` if it is not active, ``name`` is empty, or ``until`` is past or too far ahead.
        """
        ...

    def unshelve(self, alarm_id: str, name: str) -> None:
        """Unshelve an alarm. Raises ``CellwattError`` if it is not shelved or ``name`` is empty."""
        ...


S = TypeVar("S", bound=OutletSettings)


class Outlet(ABC, Generic[S]):
    """Delivers the cell's data to a consumer.

    ``offer`` is called on the event loop for every item and must only enqueue it; when the queue is full, it
    drops the oldest item and counts it in ``account``. ``run`` opens, serves until cancelled, then drains and
    closes; if it raises ``OutletError``, the daemon runs it again with back-off.
    """

    Settings: ClassVar[type[OutletSettings]]
    title: ClassVar[str]

    def __init__(self, name: str, settings: S, view: CellView) -> None:
        self.name = name
        self.settings = settings
        self.view = view
        self.account = Account()
        self.url: str | None = None
        """Address of the outlet for people, shown in health; ``None`` if it has none."""

    @abstractmethod
    def offer(self, item: Item) -> None:
        """Enqueue one item; never blocks."""

    def health(self, status: Mapping[str, Any]) -> None:
        """Receive the cell's health, about once a second; never blocks. By default it is not used."""

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over, after a reload, the items that consumers may still request from ``before``, of the same name."""

    @property
    def awaited(self) -> bool:
        """True if a consumer waits for samples and frames: they are then offered at each gather, else less often."""
        return False

    def starting(self) -> bool:
        """True while the outlet is starting normally and does not serve yet."""
        return False

    def trouble(self) -> str | None:
        """Reason why the running outlet does not serve, for health; ``None`` if all is well."""
        return None

    @abstractmethod
    async def run(self) -> None:
        """Open, serve until cancelled, drain, close."""
