"""The ur-rtde library as the client: newest state only, in a process of its own."""

from __future__ import annotations

from typing import NoReturn

from cellwatt.errors import ConnectError, ProtocolError
from cellwatt_drivers.shared import child
from cellwatt_drivers.ur import receive, wire
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Decoder, Selection


def unreadable(selection: Selection) -> list[str]:
    """Return the names of the fields that the library has no method for."""
    return [f.name for f in selection.fields if f.name not in receive.GETTERS]


async def stream(host: str, rate: float, selection: Selection, intake: Intake, timeout: float) -> NoReturn:
    """Feed the intake from the library until it fails (``SourceError``)."""
    where = f"{host} (ur_rtde)"
    decoder = Decoder(selection, receive.RECIPE, ["DOUBLE", *(_doubles(f.width) for f in selection.fields)])
    names = [f.name for f in selection.fields]
    rest = b""

    def failure(said: str) -> ConnectError:
        return ConnectError(f"{where}: {said or 'the library ended'}")

    async with child.reading(receive, host, f"{rate:g}", *names, where=where, timeout=timeout) as process:
        while True:
            rest += await process.chunk(failure)
            end = 0
            for item, used in wire.scan(memoryview(rest), wire.FROM_CONTROLLER, decoder.package):
                if not isinstance(item, wire.Run):
                    raise ProtocolError(f"{where}: {item.kind.name} from the library's process")
                intake.take(*decoder.decode(item.data, item.count))
                end = used
            rest = rest[end:]


def _doubles(width: int) -> str:
    return {1: "DOUBLE", 3: "VECTOR3D", 6: "VECTOR6D"}[width]
