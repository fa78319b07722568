"""A driver reports a missing device in words, and reads it again when it returns."""

from __future__ import annotations

import asyncio
from pathlib import Path

from cellwatt.errors import CellwattError, ConnectError, SourceError
from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import NotConformingError, Rig, require
from cellwatt.testing.running import running


async def reconnects(rig: Rig, folder: Path) -> None:
    """Run with the device off, on, off while samples arrive, and on again."""
    async with EmulatedDevice(rig, folder) as device:
        await device.switch_off()
        await _says_that_nobody_answers(rig, device.address)
        await device.switch_on()
        async with running(rig, device.address) as source:
            await source.samples(10, "after the start")
            await device.switch_off()
            seen = len(source.failures)
            await source.until(lambda: len(source.failures) > seen, "a SourceError from run() while the device is off")
            _is_readable(source.failures[-1], rig, device.address)
            await device.switch_on()
            connections = len(source.inlet.identities)
            await source.samples(10, "after the device came back")
            require(
                len(source.inlet.identities) > connections,
                "inlet.connected(identity) was not called after the device came back",
            )


async def _says_that_nobody_answers(rig: Rig, address: str) -> None:
    for what in ("identify", "run"):
        call = getattr(rig.make(address, CollectingInlet()), what)
        try:
            async with asyncio.timeout(rig.patience):
                await call()
        except ConnectError as error:
            _is_readable(error, rig, address)
        except TimeoutError:
            raise NotConformingError(f"{what}() says nothing within {rig.patience:g} s: no device is there") from None
        except Exception as error:
            kind = "map it to" if not isinstance(error, CellwattError) else "expected"
            raise NotConformingError(
                f"{what}() raised {type(error).__name__}: {error} where no device is; {kind} ConnectError"
            ) from error
        else:
            raise NotConformingError(f"{what}() returned though no device is there; expected ConnectError")


def _is_readable(error: SourceError, rig: Rig, address: str) -> None:
    """Require an error text of one line that names the address."""
    text = str(error)
    require(text and "\n" not in text, f"the error must be one line for the person at the cell, found {text!r}")
    places = {str(v) for v in rig.place(address).values()}
    require(any(p in text for p in places), f"the error does not say where: found {text!r}, expected {address} in it")
