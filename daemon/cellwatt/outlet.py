"""The contract between the daemon and a consumer of its data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, SecretStr, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from cellwatt.account import Account
from cellwatt.alarms import AlarmBook
from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.results import Event, Result


class Section(BaseModel):
    """A section of settings: unknown keys are refused, and no error repeats what was written, which may be a secret."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, hide_input_in_errors=True)


class OutletSettings(Section):
    """Settings of one outlet; every outlet derives its own."""

    def warnings(self) -> tuple[str, ...]:
        """Warnings about valid settings, one line each, shown by ``check``, ``doctor``, health and the log."""
        return ()


def both_or_neither(**settings: object) -> None:
    """Raise ``ValueError`` unless all of these settings are given, or none."""
    given = [value is not None for value in settings.values()]
    if any(given) and not all(given):
        raise ValueError(f"{' and '.join(settings)} are needed together")


def refusal(settings: BaseModel, *problems: tuple[tuple[str | int, ...], object, str]) -> ValidationError:
    """The error of settings that are wrong together, with the place, the value and the text of each problem."""
    found = [
        InitErrorDetails(type=PydanticCustomError("value_error", "{error}", {"error": text}), loc=place, input=value)
        for place, value, text in problems
    ]
    return ValidationError.from_exception_data(type(settings).__name__, found, hide_input=True)


def revealed(value: Any) -> Any:
    """Settings with their secrets, JSON-ready, for the process that serves by them and nobody else."""
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
    """Results and events told in this session, also by a predecessor of this process."""

    def put(self, item: Result | Event) -> int:
        """Add an item; return its number in its series. The item that was added last keeps its number."""
        ...

    def past(self) -> Iterator[tuple[int, Result | Event]]:
        """The last items with their numbers, each series in order."""
        ...


class CellView(Protocol):
    """The running cell as an outlet sees it. Methods may be called from any thread, orders on the event loop alone."""

    site: str
    cell: str
    folder: Path
    """Folder from which relative paths of the settings start."""
    record_folder: Path | None
    """Folder of the recordings, where there are any."""
    session: int
    """UTC ns at which this daemon started: with it, sequence numbers are unique for ever."""
    journal: Journal | None
    """Items told so far, if the process that tells may be started again within a session.

    It numbers them from the start of ``session`` on.
    """
    alarms: AlarmBook
    """Alarms that are up, with what people said of them: to be read, on the event loop alone."""

    def status(self) -> Mapping[str, Any]:
        """Health of every part with its figures, JSON-ready."""
        ...

    def config(self) -> Mapping[str, Any]:
        """The settings in force, secrets blanked, JSON-ready."""
        ...

    def schema(self) -> Mapping[str, Any]:
        """Streams and frame columns: names, units, kinds, rates, methods, JSON-ready."""
        ...

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        """Recordings kept: file, start, end, bytes, state, JSON-ready."""
        ...

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        """Recorded samples ``first`` … ``first + count`` of a stream that are still kept, in order.

        If none of them is, as many of the first that are kept after them.
        """
        ...

    def frame_history(self, session: int, first: int, count: int) -> Sequence[Frames]:
        """Recorded frames ``first`` … ``first + count`` that are still kept, in order, numbered as they were given.

        If none of them is, as many of the first that are kept after them.
        """
        ...

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        """Recorded results or events ``first`` … ``first + count`` of a series that are still kept, with their numbers.

        If none of them is, as many of the first that are kept after them. Alarms have no numbers in the record.
        """
        ...

    def acknowledge(self, alarm_id: str, name: str, note: str) -> None:
        """Note that a person knows of an alarm. Raises ``CellwattError`` where it is not up, or nobody is named."""
        ...

    def shelve(self, alarm_id: str, until: int, name: str, note: str) -> None:
        """Publish nothing of an alarm before ``until``, UTC ns, unless it becomes graver.

        Raises ``CellwattError`` where it is not up, nobody is named, or ``until`` is past or too far away.
        """
        ...

    def unshelve(self, alarm_id: str, name: str) -> None:
        """Take an alarm off the shelf. Raises ``CellwattError`` where it is not on it, or nobody is named."""
        ...


S = TypeVar("S", bound=OutletSettings)


class Outlet(ABC, Generic[S]):
    """Passes the cell's data on to a consumer.

    ``offer`` is called on the event loop for every item and must only enqueue; when its queue is full it
    drops the oldest and counts it in ``account``. ``run`` opens, serves until cancelled, then drains and
    closes; the daemon runs it again with back-off when it raises ``OutletError``.
    """

    Settings: ClassVar[type[OutletSettings]]
    title: ClassVar[str]

    def __init__(self, name: str, settings: S, view: CellView) -> None:
        self.name = name
        self.settings = settings
        self.view = view
        self.account = Account()
        self.url: str | None = None
        """Address at which people find it, for health, while there is one."""

    @abstractmethod
    def offer(self, item: Item) -> None:
        """Take one item; never blocks."""

    @abstractmethod
    def health(self, status: Mapping[str, Any]) -> None:
        """Take the cell's health, about once a second; never blocks."""

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over from the outlet of this name that new settings have ended what its consumers may still ask for."""

    @property
    def awaited(self) -> bool:
        """True if somebody waits for samples and frames: they are offered at each gather then, else less often."""
        return False

    def starting(self) -> bool:
        """True while the outlet does not serve yet, though nothing is wrong."""
        return False

    def trouble(self) -> str | None:
        """Reason why the running outlet does not serve, for health; ``None`` if all is well."""
        return None

    @abstractmethod
    async def run(self) -> None:
        """Open, serve until cancelled, drain, close."""
