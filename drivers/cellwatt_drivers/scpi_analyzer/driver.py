"""Polls a power analyzer over SCPI."""

from __future__ import annotations

import asyncio
import time
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from cellwatt.arrays import Float
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt.slots import Slots
from cellwatt_drivers.scpi_analyzer.analyzer import Analyzer
from cellwatt_drivers.scpi_analyzer.dialect import DIALECTS, Element, Model
from cellwatt_drivers.scpi_analyzer.line import Line, open_serial, open_tcp
from cellwatt_drivers.scpi_analyzer.wire import PORT, Value, parse_values
from cellwatt_drivers.shared.choice import Chosen
from cellwatt_drivers.shared.polling import NoAnswerError, deliver, keep_conversing, reason_of

FunctionName = Literal["URMS", "IRMS", "P", "S", "Q", "LAMB", "PHI", "FU", "WH"]


def _written(element: object) -> object:
    """Convert a bare 2, a number in YAML, to the name of an input."""
    return str(element) if type(element) is int else element


class ScpiAnalyzerSettings(SourceSettings):
    """A power analyzer on the network (``host``) or on a serial port (``serial``)."""

    reached_by: ClassVar[tuple[str, ...]] = ("host", "serial")

    model: Model = "hmc8015"
    """Family: R&S HMC8015, Yokogawa WT300 (WT310, WT330, …) or ZES Zimmer LMG600 (LMG610, LMG640, LMG670)."""
    element: Annotated[Element, BeforeValidator(_written)] = "1"
    """Input of an analyzer with several (wt300, lmg600); ``sigma``: their sum (wt300)."""
    host: Host | None = None
    """Address of the analyzer."""
    port: int = Field(PORT, ge=1, le=65535)
    """TCP port of its SCPI socket."""
    serial: str | None = None
    """Serial port instead of ``host``, e.g. ``/dev/ttyACM0``."""
    baud: int = Field(115200, gt=0)
    """Speed of the serial port; a USB virtual port ignores it."""
    functions: Chosen[FunctionName] = ("URMS", "IRMS", "P", "S", "Q", "LAMB")
    """Quantities to read; WH counts only while the integrator runs (not on an LMG600)."""
    rate: Hertz = 10.0
    """Polls per second; the HMC8015 makes 10 measurements a second, the others as many as set at the analyzer."""
    window: Seconds | None = Field(None, gt=0)
    """Averaging window of each value, as set at the analyzer; omitted: 0.1 s for an HMC8015, otherwise unknown."""
    timeout: Seconds = Field(1.0, gt=0)
    """Longest wait for an answer; after it the connection is opened again."""
    select: bool = True
    """Choose ``functions`` at the analyzer; ``false`` reads them from the list already set there."""
    integrate: bool = False
    """Start the analyzer's integrator (it is not stopped afterwards)."""
    error_check: Seconds = Field(10.0, gt=0)
    """Interval at which the analyzer's error queue is read."""

    @model_validator(mode="after")
    def _fits(self) -> ScpiAnalyzerSettings:
        if (self.host is None) == (self.serial is None):
            raise ValueError("write either 'host' or 'serial'")
        dialect = DIALECTS[self.model]
        if lacking := [f for f in self.functions if f not in dialect.functions]:
            raise ValueError(f"{self.model} has no {', '.join(lacking)}; it has: {', '.join(dialect.functions)}")
        if self.element not in dialect.elements:
            raise ValueError(f"{self.model} has no element {self.element}; it has: {', '.join(dialect.elements)}")
        if self.integrate and "WH" not in self.functions:
            raise ValueError("'integrate' starts the energy integrator: add WH to functions")
        return self


class ScpiAnalyzerDriver(Driver[ScpiAnalyzerSettings]):
    """One analyzer. After a late, cut or invalid answer the connection is opened again, because every later answer
    would be mistaken for that of the query before it.
    """

    Settings = ScpiAnalyzerSettings
    title = "Power analyzers over SCPI (R&S HMC8015, Yokogawa WT300, ZES LMG600; TCP or serial)"
    emulator = "cellwatt_drivers.scpi_analyzer.emulator:ScpiAnalyzerEmulator"
    writes = (
        "queries: *IDN?, SYST:ERR? (takes entries off the error queue), CHAN1:MEAS:FUNC?, CHAN1:MEAS:DATA?",
        "unless select is false: CHAN1:MEAS:FORM ASC, CHAN1:MEAS:FUNC <functions> (what DATA? answers; the list found "
        "before is written back when the connection is closed in order)",
        "only where integrate is true: INT:MODE MAN, INT:STAT ON, INT:STAR (not stopped afterwards)",
        "wt300, queries: *IDN?, :STAT:ERR?, :NUM:NORM:NUM?, :NUM:NORM:ITEM<n>?, :NUM:NORM:VAL?; unless select is "
        "false: :NUM:FORM ASC, :NUM:NORM:NUM <n>, :NUM:NORM:ITEM<n> <function>,<element> (put back as above); only "
        "where integrate is true: :INTEG:MODE NORM, :INTEG:STAR",
        "lmg600: *IDN?, *ZLANG SHORT and *ZLANG SCPI (the language of this connection), SYST:ERR?, INIM;<functions> "
        "(takes over the newest cycle's values for this connection and answers them)",
    )

    def __init__(self, name: str, settings: ScpiAnalyzerSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        self._dialect = DIALECTS[settings.model]
        self._items = self._dialect.items(settings.functions, settings.element)
        functions = [self._dialect.functions[f] for f in settings.functions]
        self._scale = np.array([f.scale for f in functions])
        window = settings.window or self._dialect.window
        channels = (replace(f.channel, window=0.0 if f.channel.kind == "counter" else window) for f in functions)
        self._stream = Stream("measured", tuple(channels), settings.rate, "host")
        self._slots = Slots(settings.rate, inlet.account.lose)
        self._last_text = ""
        self._overloaded: set[str] = set()
        self._before: tuple[str, ...] = ()

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The one stream, ``measured``."""
        return (self._stream,)

    async def identify(self) -> Identity:
        """Identify the analyzer by ``*IDN?``. Raises ``SourceError``."""
        async with self._open() as line:
            return await self._analyzer(line).identify()

    async def run(self) -> None:
        """See ``Driver.run``. A connection that has delivered samples is reopened at once, any other raises."""
        await keep_conversing(self, self._converse)

    def _open(self) -> AbstractAsyncContextManager[Line]:
        s = self.settings
        if s.serial is not None:
            return open_serial(s.serial, s.baud, self.inlet.now)
        assert s.host is not None
        return open_tcp(s.host, s.port, s.timeout, self.inlet.now)

    def _analyzer(self, line: Line) -> Analyzer:
        return Analyzer(line, self._dialect, self.settings.timeout)

    async def _converse(self) -> None:
        """Run one connection, from the greeting on."""
        try:
            await self._use_line()
        except (NoAnswerError, ProtocolError) as error:
            self.inlet.account.anomaly("timeouts" if isinstance(error, NoAnswerError) else "malformed")
            raise

    async def _use_line(self) -> None:
        async with self._open() as line:
            analyzer = self._analyzer(line)
            identity = await analyzer.identify()
            self._report(await analyzer.errors(), "from before this connection")
            try:
                order = await self._set_up(analyzer)
                self.inlet.connected(identity)
                await self._poll(analyzer, order)
            except asyncio.CancelledError:
                # On a proper close only: after a failure the analyzer might execute this late, after the next set-up.
                if self._before:
                    with suppress(ConnectError):
                        analyzer.tell(self._dialect.selection(self._before))
                raise

    async def _set_up(self, analyzer: Analyzer) -> tuple[str, ...]:
        """Make the analyzer return the functions; returns all items of its answers, in order."""
        wanted = self._items
        analyzer.tell(self._dialect.prepare)
        order = await analyzer.selected(wanted)
        if self.settings.select and order != wanted:
            self._before = order
            await analyzer.choose(wanted)
            order = await analyzer.selected(wanted)
        if missing := [f for f in wanted if f not in order]:
            refused = "it does not take the selection: is it locked or in local mode?"
            advice = refused if self.settings.select else "choose them there, or set select: true"
            raise DeviceError(f"the analyzer's list {', '.join(order)} lacks {', '.join(missing)}: {advice}")
        if self.settings.integrate:
            analyzer.tell(self._dialect.integrate)
            self._report(await analyzer.errors(), "at the start of the integrator")
        return order

    async def _poll(self, analyzer: Analyzer, order: tuple[str, ...]) -> None:
        columns = [order.index(item) for item in self._items]
        check = time.monotonic() + self.settings.error_check
        async with self._slots as slots:
            async for _ in slots:
                await self._read(analyzer, columns, order)
                if time.monotonic() >= check:
                    check = time.monotonic() + self.settings.error_check
                    self._report(await analyzer.errors(), "while measuring")
                    if (found := await analyzer.selected(self._items)) != order:
                        raise ProtocolError(f"the analyzer's list became {', '.join(found)}: by whom was it changed?")

    async def _read(self, analyzer: Analyzer, columns: list[int], order: tuple[str, ...]) -> None:
        try:
            answer = await analyzer.read(order)
            values = parse_values(answer.text, len(order), self._dialect.separator)
        except SourceError as error:
            self.inlet.account.lose(1, reason_of(error))
            raise
        if answer.text == self._last_text:
            self.inlet.account.count("repeats")
        self._last_text = answer.text
        row, quality = self._measured([values[c] for c in columns])
        deliver(self.inlet, self._stream, row, answer.asked, answer.arrival, quality)

    def _measured(self, values: list[Value]) -> tuple[Float, Quality]:
        """Return the values (functions,) in SI units and their quality."""
        row = np.array([v.number for v in values]) * self._scale
        overloaded: set[str] = {f for f, v in zip(self.settings.functions, values, strict=True) if v.overload}
        quality = Quality.GOOD
        if overloaded:
            quality = Quality.CLIPPED
            self.inlet.account.count("overloads")
        elif np.isnan(row).all():
            quality = Quality.MISSING
        if overloaded - self._overloaded:
            names = ", ".join(f for f in self.settings.functions if f in overloaded)
            self.inlet.event("overload", f"{self.name}: {names} overloaded: the range is too small", functions=names)
        self._overloaded = overloaded
        return row, quality

    def _report(self, errors: list[tuple[int, str]], when: str) -> None:
        for code, text in errors:
            self.inlet.account.count("instrument errors")
            self.inlet.event(
                "instrument_error", f"{self.name}: the analyzer's error queue, {when}: {code} {text}", code=float(code)
            )
