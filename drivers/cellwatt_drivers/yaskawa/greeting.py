"""Reads a controller's identity, and tries each read that the settings select."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from cellwatt.driver import Identity
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, WrongDeviceError
from cellwatt_drivers.yaskawa import payload, wire
from cellwatt_drivers.yaskawa.link import Link, UnansweredError
from cellwatt_drivers.yaskawa.polls import Poll

T = TypeVar("T")

_SYSTEM = wire.Request(wire.SYSTEM, 11)
_RETRIES = 3
_HINT = "check the address, the cable, and that the controller's Ethernet server is set up"


async def greet(link: Link, group: int, axes: int, polls: Sequence[Poll]) -> Identity:
    """Read system information, axis names of the control group, and the data of each poll once.

    Raises ``ConnectError`` if no device answers, ``WrongDeviceError`` if the answers are not this protocol or the robot
    has fewer axes than configured, ``DeviceError`` if the controller refuses one of the reads, and ``ProtocolError`` if
    its answer has another form.
    """
    system = await _optional(link, _SYSTEM, payload.decode_system) or payload.System("", "", "")
    names = await _optional(link, wire.Request(wire.AXIS_NAMES, group), payload.decode_axis_names) or ()
    if names and len(names) < axes:
        raise WrongDeviceError(
            f"robot R{group} at {link.place} has {len(names)} axes ({' '.join(names)}), the settings say {axes}"
        )
    for poll in polls:
        name = "status" if poll.request.command == wire.STATUS else poll.stream.name
        try:
            poll.values((await link.ask(poll.request, _RETRIES)).answer.data)
        except UnansweredError as failure:
            raise _refusal(link, name, failure) from failure
        except ProtocolError as error:
            link.count_malformed()
            raise ProtocolError(f"{link.place}, {name}: {error}") from error
    notes = {"axes": " ".join(names), "parameters": system.parameters}
    return Identity(
        "Yaskawa", system.model or "unknown", firmware=system.software, notes={k: v for k, v in notes.items() if v}
    )


async def _optional(link: Link, request: wire.Request, decode: Callable[[bytes], T]) -> T | None:
    """Read data that not every controller has; raise if no device answers at all."""
    try:
        return decode((await link.ask(request, _RETRIES)).answer.data)
    except ProtocolError:
        link.count_malformed()
    except UnansweredError as failure:
        if failure.reason not in {"device error", "busy"}:
            raise _silent(link, failure) from failure
    return None


def _refusal(link: Link, name: str, failure: UnansweredError) -> Exception:
    if failure.reason != "device error":
        return _silent(link, failure)
    return DeviceError(f"{link.place} refuses to give {name}: {failure}; remove it from 'read' or check control_group")


def _silent(link: Link, failure: UnansweredError) -> Exception:
    if link.malformed:
        return WrongDeviceError(f"{link.place} answers, but not with High-Speed Ethernet Server frames; {_HINT}")
    return ConnectError(f"no device answers at UDP {link.place} ({failure}); {_HINT}")
