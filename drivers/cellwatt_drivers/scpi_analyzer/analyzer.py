"""Requests to an analyzer in the commands of its dialect."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence

from cellwatt.driver import Identity
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, WrongDeviceError
from cellwatt_drivers.scpi_analyzer.dialect import Dialect
from cellwatt_drivers.scpi_analyzer.line import Answer, Line
from cellwatt_drivers.scpi_analyzer.wire import parse_count, parse_error, parse_identification

_DEEPEST_QUEUE = 50


class Analyzer:
    """An analyzer on a ``line``; waits ``timeout`` s for each answer. All methods raise ``SourceError``."""

    def __init__(self, line: Line, dialect: Dialect, timeout: float) -> None:
        self._line = line
        self._dialect = dialect
        self._timeout = timeout

    async def identify(self) -> Identity:
        """Ask for the identification; skip answers to earlier queries that arrive first.

        Raises ``WrongDeviceError`` if a device other than the dialect's model answers.
        """
        loop = asyncio.get_running_loop()
        end = loop.time() + self._timeout
        self._line.tell(self._dialect.identify)
        answer = ""
        while True:
            try:
                text, _ = await self._line.read(max(0.0, end - loop.time()))
            except ProtocolError as error:
                answer = answer or str(error)
                continue
            except ConnectError:
                if not answer:
                    raise
                model = self._dialect.model
                raise WrongDeviceError(
                    f"{self._line.place} is not {_article(model)} {model}: it answers {answer[:80]!r}; "
                    "check the address, or the speed of the serial port"
                ) from None
            if (self._dialect.known or self._dialect.model) in text.upper():
                return parse_identification(text, self._dialect.maker)
            answer = answer or text

    def tell(self, commands: Iterable[str]) -> None:
        """Send commands without an answer."""
        for command in commands:
            self._line.tell(command)

    async def selected(self, wanted: Sequence[str]) -> tuple[str, ...]:
        """Ask for the items that ``read`` returns, in order; ``wanted`` if the query itself names them."""
        dialect = self._dialect
        if not dialect.selected:
            return tuple(wanted)
        if not dialect.count:
            answer = await self._line.ask(dialect.selected, self._timeout)
            return tuple(dialect.found(name) for name in answer.text.split(dialect.separator))
        answer = await self._line.ask(dialect.count, self._timeout)
        found = []
        for number in range(1, parse_count(answer.text) + 1):
            item = await self._line.ask(dialect.selected.format(number=number), self._timeout)
            found.append(dialect.found(item.text))
        return tuple(found)

    async def choose(self, items: Sequence[str]) -> None:
        """Choose and order the items that ``read`` returns. Raises ``DeviceError`` with the analyzer's error."""
        self.tell(self._dialect.selection(items))
        errors = await self.errors()
        if errors:
            code, text = errors[0]
            raise DeviceError(f"{self._line.place} refuses the functions {', '.join(items)}: {code} {text}")

    async def errors(self) -> list[tuple[int, str]]:
        """Take all entries off the error queue, oldest first."""
        found: list[tuple[int, str]] = []
        self.tell(self._dialect.before_errors)
        while len(found) < _DEEPEST_QUEUE:
            answer = await self._line.ask(self._dialect.errors, self._timeout)
            code, text = parse_error(answer.text)
            if code == 0:
                break
            found.append((code, text))
        self.tell(self._dialect.after_errors)
        return found

    async def read(self, items: Sequence[str]) -> Answer:
        """Request one line of measured values."""
        return await self._line.ask(self._dialect.query(items), self._timeout)


def _article(model: str) -> str:
    """``a`` or ``an``, by the pronunciation of the model's first letter."""
    return "an" if model[0] in "AEFHILMNORSX" else "a"
