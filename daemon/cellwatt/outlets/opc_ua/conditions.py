"""Alarms as OPC UA conditions, which clients follow and acknowledge."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from asyncua import Node, Server, ua
from asyncua.server.event_generator import EventGenerator

from cellwatt.errors import CellwattError
from cellwatt.outlets.opc_ua.robotics import add_node

USER: ContextVar[str | None] = ContextVar("user", default=None)
"""Name of the user whose client is calling a method."""
_SEVERITY: Final = {"info": 200, "warning": 500, "error": 800}
_LONGEST_NOTE: Final = 1000

Order = Callable[[Mapping[str, Any]], Awaitable[Any]]
"""Sends an order to the daemon; raises ``CellwattError`` with the reason if it is refused."""


@dataclass
class _Condition:
    """One alarm: its event generator, the ids of its latest events, and its state."""

    generator: EventGenerator
    told: list[bytes]
    active: bool = True
    acknowledged: bool = False


class Conditions:
    """Conditions of a cell by alarm; ``own`` is the namespace index of their nodes."""

    def __init__(self, server: Server, own: int, parent: Node, order: Order) -> None:
        self._server = server
        self._own = own
        self._parent = parent
        self._order = order
        self._known: dict[str, _Condition] = {}

    def listen(self) -> None:
        """Accept acknowledgements from clients."""
        method = ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge)
        self._server.iserver.isession.add_method_callback(method, self._acknowledge)

    async def tell(self, alarm: Mapping[str, Any]) -> None:
        """Notify clients that an alarm is active, has changed, or is cleared."""
        name = str(alarm["id"])
        known = self._known.get(name)
        if known is None:
            if not alarm["active"]:
                return
            known = self._known[name] = _Condition(await self._generator(alarm), [])
        elif alarm["active"] and not known.active:
            known.acknowledged = False
        known.active = bool(alarm["active"])
        event = known.generator.event
        event.Severity = _SEVERITY.get(alarm["severity"], 500)
        event.Message = ua.LocalizedText(alarm["statement"])
        event.Comment = None
        await self._trigger(known, alarm["time"])

    async def acknowledged(self, alarm: str, name: str, note: str) -> None:
        """Notify clients that a person acknowledged an alarm, through any outlet."""
        known = self._known.get(alarm)
        if known is None or known.acknowledged:
            return
        known.acknowledged = True
        known.generator.event.Comment = ua.LocalizedText(note)
        known.generator.event.ClientUserId = name
        await self._trigger(known, None)

    async def _generator(self, alarm: Mapping[str, Any]) -> EventGenerator:
        """Make the condition's node and its event generator."""
        server, name = self._server, str(alarm["id"])
        kind = ua.NodeId(ua.ObjectIds.AlarmConditionType)
        node_id = ua.NodeId(f"alarm:{name}", self._own)
        if node_id not in server.iserver.aspace:
            browsed = ua.QualifiedName(str(alarm["kind"]), self._own)
            await add_node(server, self._parent, node_id, browsed, kind, ua.ObjectAttributes())
        generator = await server.get_event_generator(kind, ua.ObjectIds.Server)
        event = generator.event
        event.NodeId = node_id
        event.SourceNode = self._parent.nodeid
        event.SourceName = str(alarm["source"] or "cell")
        event.ConditionName = str(alarm["kind"])
        event.ConditionClassId = ua.NodeId(ua.ObjectIds.ProcessConditionClassType)
        event.ConditionClassName = ua.LocalizedText("ProcessConditionClass")
        event.BranchId = ua.NodeId()
        event.Quality = ua.StatusCode()
        event.InputNode = ua.NodeId()
        event.SuppressedOrShelved = False
        event.EnabledState = ua.LocalizedText("Enabled")
        setattr(event, "EnabledState/Id", True)
        return generator

    async def _trigger(self, known: _Condition, time: int | None) -> None:
        event = known.generator.event
        event.ActiveState = ua.LocalizedText("Active" if known.active else "Inactive")
        setattr(event, "ActiveState/Id", known.active)
        event.AckedState = ua.LocalizedText("Acknowledged" if known.acknowledged else "Unacknowledged")
        setattr(event, "AckedState/Id", known.acknowledged)
        event.Retain = known.active
        moment = datetime.fromtimestamp(time / 1e9, UTC) if time else None
        await known.generator.trigger(moment)
        told = event.EventId
        known.told = [*known.told[-9:], bytes(told.Value if isinstance(told, ua.Variant) else told)]

    async def _acknowledge(self, condition: ua.NodeId, event: ua.Variant, comment: ua.Variant) -> ua.StatusCode:
        """Acknowledge the alarm of a condition for the user of the session."""
        codes = ua.StatusCodes
        name = str(condition.Identifier).removeprefix("alarm:") if condition.NamespaceIndex == self._own else ""
        known = self._known.get(name)
        if known is None:
            return ua.StatusCode(codes.BadNodeIdUnknown)
        if event.Value not in known.told:
            return ua.StatusCode(codes.BadEventIdUnknown)
        if known.acknowledged:
            return ua.StatusCode(codes.BadConditionBranchAlreadyAcked)
        user = USER.get()
        if not user:
            return ua.StatusCode(codes.BadUserAccessDenied)
        text = comment.Value.Text if isinstance(comment.Value, ua.LocalizedText) else None
        note = (text or "")[:_LONGEST_NOTE]
        try:
            await self._order({"what": "acknowledge", "alarm": name, "name": user, "note": note})
        except CellwattError:
            return ua.StatusCode(codes.BadInvalidState)
        return ua.StatusCode(codes.Good)
