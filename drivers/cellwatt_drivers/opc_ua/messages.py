"""Converts published messages to plain numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from cellwatt_drivers.opc_ua.nodes import TagPlace

if TYPE_CHECKING:
    from asyncua import ua

EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_NEVER: Final = 2200
"""Year from which on a time means "no time": ns of 64 bits end in 2262."""
_SEVERITY: Final = 0xC000_0000
_UNCERTAIN: Final = 0x4000_0000
OVERFLOW: Final = 0x0480
"""Info bits of a data value whose queue has overflowed: type DataValue and the overflow bit."""


@dataclass(frozen=True, slots=True)
class Item:
    """A value of one column in SI units; NaN with a bad ``status``. ``stamp``: the source's, ns UTC; 0 without one."""

    column: int
    stamp: int
    value: float
    status: int = 0
    malformed: bool = False

    @property
    def bad(self) -> bool:
        """True if the server marks the value as unusable."""
        return bool(self.status & 0x8000_0000)

    @property
    def unknown(self) -> bool:
        """True if the server has removed the node (BadNodeIdUnknown)."""
        return self.status & 0xFFFF_0000 == 0x8034_0000

    @property
    def uncertain(self) -> bool:
        """True if the server marks the value as uncertain."""
        return self.status & _SEVERITY == _UNCERTAIN

    @property
    def overflow(self) -> bool:
        """True if the server's queue lost values before or after this one."""
        return self.status & OVERFLOW == OVERFLOW


@dataclass(frozen=True, slots=True)
class Message:
    """One published message: its number, and the server's time of publication, ns UTC; a keep-alive has no items."""

    sequence: int
    published: int
    items: tuple[Item, ...]
    ended: str = ""
    """Status with which the server ended the subscription; empty while it lasts."""


def read(result: ua.PublishResult, sources: Mapping[int, Sequence[TagPlace]], server_time: bool) -> Message:
    """Convert a message; ``sources`` by client handle, ``server_time``: use the server's time stamps."""
    message = result.NotificationMessage
    items: list[Item] = []
    ended = ""
    for part in message.NotificationData or []:
        if hasattr(part, "MonitoredItems"):
            for notification in part.MonitoredItems:
                items += _items(notification, sources, server_time)
        elif hasattr(part, "Status"):
            ended = part.Status.name
    return Message(int(message.SequenceNumber), nanoseconds(message.PublishTime), tuple(items), ended)


def _items(
    notification: ua.MonitoredItemNotification, sources: Mapping[int, Sequence[TagPlace]], server_time: bool
) -> Iterator[Item]:
    data = notification.Value
    status = int(data.StatusCode.value) if data.StatusCode is not None else 0
    stamp = nanoseconds(data.ServerTimestamp if server_time else data.SourceTimestamp)
    content = data.Value.Value if data.Value is not None else None
    for source in sources.get(int(notification.ClientHandle), ()):
        if status & 0x8000_0000:
            yield Item(source.column, stamp, float("nan"), status)
            continue
        try:
            yield Item(source.column, stamp, source.si(content), status)
        except (TypeError, ValueError, IndexError, OverflowError):
            yield Item(source.column, stamp, float("nan"), status, malformed=True)


def nanoseconds(moment: datetime | None) -> int:
    """Return UTC ns of a time; 0 for none, and for OPC UA's smallest (1601) and largest times."""
    if moment is None or moment.year >= _NEVER:
        return 0
    aware = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    since = aware - EPOCH
    return max(0, ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * 1000)


def status_name(code: int) -> str:
    """Name of a status code, like ``BadSensorFailure``."""
    from asyncua import ua

    status: ua.StatusCode = ua.StatusCode(code & 0xFFFF_0000)
    return str(status.name)
