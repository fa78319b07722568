"""Sensor maps: YAML files that assign the signals of a DBC file to channels."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from cellwatt.channel import Channel
from cellwatt.config import read_settings
from cellwatt.config.wording import did_you_mean
from cellwatt.errors import ConfigError
from cellwatt.files import read_bytes
from cellwatt.quantity import Seconds
from cellwatt.section import Section
from cellwatt.tables.encoding import text_of
from cellwatt_drivers.shared.maps import SCALED, ChannelName

if TYPE_CHECKING:
    from cantools.database.can import Message

ANY_SOURCE = 0xFE
"""Source address in a DBC file of J1939 whose messages any node may send."""
ANY_DESTINATION = (0xFE, 0xFF)
"""Destinations in a DBC file of J1939 that stand for any."""

SensorName = Literal["ivt_s"]
"""Packaged maps."""

StreamName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Flag = Literal["clipped", "missing", "told"]

_SI = SCALED | {
    alias: SCALED[unit]
    for unit, aliases in {"1": ("", "-"), "deg": ("°",), "rpm": ("1/min",), "degC": ("°C", "C")}.items()
    for alias in aliases
}
"""Units as written in DBC files, with SI units per such a unit."""


class SensorSignal(Section):
    """A signal whose unit is missing or wrong in the DBC file, or a counter."""

    channel: ChannelName
    """Channel of the signal."""
    unit: str | None = None
    """Unit, instead of the DBC file's."""
    counter: bool = False
    """The value only rises: it is held, not interpolated."""


class SensorStream(Section):
    """One message and the signals read from it."""

    message: str
    """Name of the message in the DBC file."""
    cycle: Seconds = Field(0.0, ge=0)
    """Time between two messages; 0 s: sent on change, so losses cannot be detected."""
    counter: str | None = None
    """Signal that counts the messages, so that every lost one is known."""
    flags: dict[str, Flag] = Field(default_factory=dict)
    """Signals that are 1 on a fault: the sample is ``clipped`` or ``missing``; ``told``: the flag is only reported."""
    signals: dict[str, ChannelName | SensorSignal] = Field(min_length=1)
    """Channels by signal."""
    optional: bool = False
    """Read only if the settings name it."""

    @cached_property
    def needed(self) -> frozenset[str]:
        """All signals that a sample needs."""
        return frozenset((*self.signals, *self.flags, *([self.counter] if self.counter else [])))


class SensorMap(Section):
    """A model of sensor."""

    maker: str
    """Maker of the sensor."""
    model: str
    """Model of the sensor."""
    source: str = ""
    """Source of this map."""
    dbc: Path
    """DBC file; a relative path starts at the map's folder."""
    streams: dict[StreamName, SensorStream] = Field(min_length=1)
    """Streams by name."""

    @model_validator(mode="after")
    def _one_each(self) -> SensorMap:
        used = Counter((s.message, signal) for s in self.streams.values() for signal in s.signals)
        for (message, signal), n in used.items():
            if n > 1:
                raise ValueError(
                    f"streams: {signal} of {message} is in {n} of them; each message feeds one stream, or one for each "
                    "of its pages"
                )
        return self


@dataclass(frozen=True)
class Decoding:
    """A stream's message from the DBC file, and the conversion of its signals to channels, in order."""

    name: str
    wanted: SensorStream
    message: Message
    channels: tuple[Channel, ...]
    factors: tuple[float, ...]
    pages: Mapping[str, frozenset[int]]
    """Values of each multiplexer at which a frame carries the signals."""

    @property
    def is_j1939(self) -> bool:
        """True for a message of J1939: by the DBC file, or if that does not say, by the placeholder of its source."""
        message = self.message
        told = message.dbc is not None and "VFrameFormat" in message.dbc.attributes
        placed = message.is_extended_frame and message.frame_id & 0xFF == ANY_SOURCE
        return message.protocol == "j1939" or (placed and not told)

    @cached_property
    def _absent(self) -> Mapping[str, int]:
        """Smallest raw numbers, by signal, that mean "not available" or an error in J1939."""
        return {
            name: 0xFB << signal.length - 8 if signal.length >= 8 else 2**signal.length - 1
            for name, signal in ((n, _signal(self.message, n)) for n in self.wanted.signals if self.is_j1939)
            if not signal.is_signed and not signal.conversion.is_float and signal.length > 1
        }

    @property
    def counter(self) -> tuple[int | None, int | None, bool]:
        """Number of values of the message's counter by its bits and by its range; whether it counts all pages."""
        if self.wanted.counter is None:
            return None, None, False
        signal = _signal(self.message, self.wanted.counter)
        whole = 1 << signal.length
        stated = min(whole, int(signal.maximum) + 1) if signal.maximum and not signal.minimum else None
        return whole, stated, bool(self.pages) and signal.multiplexer_ids is None

    @cached_property
    def _flat(self) -> Message:
        return _without_pages(self.message, self.wanted.needed | self.pages.keys())

    def decode(self, data: bytes) -> Mapping[str, float]:
        """Decode the signals, by name, in the DBC file's units.

        Signals of ``wanted.signals`` that lie beyond a short frame are left out; a frame with another page has none.
        Values that are not available are NaN.
        Raises ``ValueError`` if the frame is too short for all of them, or for a flag, the counter or a multiplexer.
        """
        flat, wanted = self._flat, self.wanted
        raw: Any = flat.decode(data, decode_choices=False, scaling=False, allow_truncated=True)
        if not self.pages.keys() <= raw.keys():
            raise self._short(data)
        if any(raw[name] not in values for name, values in self.pages.items()):
            return {}
        if not raw.keys() & wanted.signals.keys() or not wanted.needed - wanted.signals.keys() <= raw.keys():
            raise self._short(data)
        found: dict[str, Any] = {
            s.name: s.conversion.raw_to_scaled(raw[s.name], decode_choices=False)
            for s in flat.signals
            if s.name in raw and s.name in wanted.needed
        }
        return found | {n: math.nan for n, least in self._absent.items() if raw.get(n, 0) >= least}

    def _short(self, data: bytes) -> ValueError:
        return ValueError(f"{self.message.name}: a frame of {len(data)} bytes is too short for {self.name}")


def group_of(identifier: int) -> int:
    """Parameter group of a J1939 identifier: without priority and source, and without destination if it has one."""
    return identifier & (0x3FF_0000 if has_destination(identifier) else 0x3FF_FF00)


def has_destination(identifier: int) -> bool:
    """True if the J1939 identifier contains a destination."""
    return identifier >> 16 & 0xFF < 0xF0


def _without_pages(message: Message, names: Iterable[str]) -> Message:
    """Return the message with the named signals only, decoded in every frame, whatever its page."""
    from cantools.database.can import Message

    signals = [copy(_signal(message, name)) for name in names]
    for signal in signals:
        signal.is_multiplexer, signal.multiplexer_ids, signal.multiplexer_signal = False, None, None
    return Message(
        message.frame_id,
        message.name,
        message.length,
        signals,
        is_extended_frame=message.is_extended_frame,
        is_fd=message.is_fd,
        strict=False,
    )


def load_decodings(sensor: SensorName | None, path: Path | None) -> tuple[SensorMap, dict[str, Decoding]]:
    """Read the packaged map, or the one at ``path``, with its DBC file.

    Raises ``ConfigError`` with every mistake of the map and its line and column.
    """
    import cantools
    from cantools.database.errors import Error

    path = path or Path(__file__).parent / "sensors" / f"{sensor}.yaml"
    made = read_settings(path, SensorMap)
    made = made.model_copy(update={"dbc": path.parent / made.dbc})
    try:
        text = text_of(read_bytes(made.dbc))
        database: Any = cantools.database.load_string(text, database_format="dbc", strict=False)
    except (OSError, ValueError, Error) as error:
        raise ConfigError(f"{made.dbc}: cannot be read as a DBC file: {error}") from error
    messages = {m.name: m for m in database.messages}
    found = {}
    for name, wanted in made.streams.items():
        message = messages.get(wanted.message)
        if message is None:
            hint = did_you_mean(wanted.message, messages)
            raise ConfigError(f"{made.dbc}: no message {wanted.message!r}{hint} (stream {name})")
        found[name] = _decoding(name, wanted, message)
    return made, found


def _decoding(name: str, wanted: SensorStream, message: Message) -> Decoding:
    channels, factors = [], []
    for signal, target in wanted.signals.items():
        known = _signal(message, signal)
        spec = target if isinstance(target, SensorSignal) else SensorSignal(channel=target)
        unit = spec.unit if spec.unit is not None else known.unit or ""
        if unit not in _SI:
            raise ConfigError(
                f"signal {signal} of {message.name} is in {unit!r}: write 'signals: {{{signal}: {{channel: "
                f"{spec.channel}, unit: …}}}}' with one of {', '.join(u for u in _SI if u)}"
            )
        si, factor = _SI[unit]
        kind: Literal["counter", "continuous"] = "counter" if spec.counter else "continuous"
        channels.append(Channel(spec.channel, si, kind, "hold" if si == "J" else None))
        factors.append(factor)
    return Decoding(name, wanted, message, tuple(channels), tuple(factors), _pages(name, wanted, message))


def _pages(name: str, wanted: SensorStream, message: Message) -> Mapping[str, frozenset[int]]:
    """Return the values of each multiplexer at which a frame carries all signals of a stream.

    Raises ``ConfigError`` if no frame can carry all of them.
    """
    pages: dict[str, frozenset[int]] = {}
    by: dict[str, str] = {}
    for needed in sorted(wanted.needed):
        signal = _signal(message, needed)
        while signal.multiplexer_ids is not None:
            selector, values = signal.multiplexer_signal, frozenset(signal.multiplexer_ids)
            together = values & pages.get(selector, values)
            if not together:
                raise ConfigError(
                    f"stream {name}: no frame of {message.name} carries both {by[selector]} and {needed}, which are on "
                    f"different pages of {selector}: write a stream for each page"
                )
            pages[selector] = together
            by.setdefault(selector, needed)
            signal = _signal(message, selector)
    return pages


def _signal(message: Message, name: str) -> Any:
    for signal in message.signals:
        if signal.name == name:
            return signal
    names = [s.name for s in message.signals]
    raise ConfigError(
        f"message {message.name} has no signal {name!r}{did_you_mean(name, names)} (it has: {', '.join(names)})"
    )
