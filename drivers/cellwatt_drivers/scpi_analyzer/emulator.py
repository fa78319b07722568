"""A power analyzer's SCPI port: TCP or a pseudo-terminal."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from cellwatt.emulation import Options, PortEmulator
from cellwatt.emulation.terminal import Writer, port_of
from cellwatt_drivers.scpi_analyzer.emulated_analyzer import FUNCTIONS, EmulatedAnalyzer
from cellwatt_drivers.scpi_analyzer.emulated_makes import EmulatedLmg670, EmulatedWt310
from cellwatt_drivers.scpi_analyzer.wire import PORT

_MAKES: Mapping[str, tuple[type[EmulatedAnalyzer], str]] = {
    "hmc8015": (EmulatedAnalyzer, "Rohde&Schwarz,HMC8015,000000001,HW10000000,SW1.403"),
    "wt300": (EmulatedWt310, "YOKOGAWA,WT310E,C2XX00001V,F1.03"),
    "lmg600": (EmulatedLmg670, "ZES ZIMMER Electronic Systems GmbH,LMG670,00000001,7.134"),
}
"""Instrument and answer to ``*IDN?``, by the driver's ``model``."""


class ScpiAnalyzerEmulator(PortEmulator):
    """One analyzer on the mains of ``supply.power``, ``supply.voltage`` and ``supply.current``.

    Listens on 127.0.0.1:5025 by default; ``pty``, or the path of a link to it, makes it a serial port. Options:
    ``model`` (``hmc8015``, ``wt300``: a WT310E, ``lmg600``: an LMG670), ``idn`` (the answer to ``*IDN?``), ``overload``
    (functions, comma-separated, whose input is too large from the start).

    Faults on measured values (answers to ``DATA?``, ``VAL?`` or ``INIM``): ``loss`` (not sent), ``half_frame`` (cut,
    without its end), ``delay`` (late by ``seconds``), ``garbage`` (a line of random bytes before it). At the next line
    received, ``stall`` delays the answer by ``seconds``; ``disconnect`` closes the port for ``seconds``, on a
    pseudo-terminal all bytes are then lost. ``made`` counts queries for data, ``sent`` whole answers to them.
    """

    title: ClassVar[str] = "Power analyzer (SCPI: R&S HMC8015, Yokogawa WT310E, ZES LMG670)"
    usual_address: ClassVar[str] = f"127.0.0.1:{PORT}"
    line = "serial"

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``."""
        return {"model": sources[0].model}

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        make, identification = _MAKES[options.choice("model", "hmc8015", tuple(_MAKES))]
        self.analyzer = make(self.signals, options.text("idn", identification))
        overload = [name for name in options.text("overload").split(",") if name]
        self.analyzer.overload = FUNCTIONS.intersection(overload)
        if unknown := set(overload) - self.analyzer.overload:
            raise ValueError(f"overload names functions it does not measure: {', '.join(sorted(unknown))}")
        self.lines: Counter[str] = Counter()
        self.port = port_of(self, self._talk)

    async def _talk(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        while data := await reader.readline():
            await self.port.asked()
            line = data.decode("ascii", "replace").strip()
            self.lines[line] += 1
            answer = self.analyzer.execute(line, self.elapsed)
            if answer is None:
                continue
            frame = answer.encode() + b"\n"
            if self.analyzer.data_query in line.upper():
                await self.port.answer(frame, writer.write, lambda noise: noise.replace(b"\n", b"\0") + b"\n")
            else:
                writer.write(frame)
