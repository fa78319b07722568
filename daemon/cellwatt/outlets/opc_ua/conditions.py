"""Alarms as OPC UA conditions, which clients follow and acknowledge."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from asyncua import Node, Server, ua
from asyncua.server.event_generator import EventGenerator

from cellwatt.alarms import FollowedAlarms, Standing
from cellwatt.errors import CellwattError
from cellwatt.results import Alarm, Event

USER: ContextVar[str | None] = ContextVar("user", default=None)
"""Name of the user whose client is calling a method."""
_SEVERITY: Final = {"info": 200, "warning": 500, "error": 800}
_LONGEST_NOTE: Final = 1000

Order = Callable[[Mapping[str, Any]], Awaitable[Any]]
"""Sends an order to the daemon; raises ``CellwattError`` with the reason if it is refused."""


@dataclass
class _Condition:
    """One alarm: its event generator, the ids of its latest events, and whether it was acknowledged while active."""

    generator: EventGenerator
    events: list[bytes]
    acknowledged: bool = False


class Conditions:
    """Conditions of a cell by alarm; ``own`` is the namespace index of their nodes."""

    def __init__(self, server: Server, own: int, parent: Node, order: Order) -> None:
        self._server = server
        self._own = own
        self._parent = parent
        self._order = order
        self._alarms = FollowedAlarms()
        self._known: dict[str, _Condition] = {}

    def listen(self) -> None:
        """Accept acknowledgements from clients."""
        method = ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge)
        self._server.iserver.isession.add_method_callback(method, self._acknowledge)

    async def hear(self, alarm: Alarm) -> None:
        """Notify clients that an alarm is active, has changed, or is cleared."""
        await self._show(self._alarms.hear(alarm))

    async def note(self, event: Event) -> None:
        """Notify clients that a person acknowledged an alarm, through any outlet."""
        for standing in self._alarms.note(event):
            known = self._known.get(standing.alarm.id)
            if known is None or not known.acknowledged:
                await self._show(standing)

    async def agree(self, health: Mapping[str, Any]) -> None:
        """Notify clients of the alarms that differ in the cell's health: a new process did not get their messages."""
        for standing in self._alarms.agree(health):
            await self._show(standing)

    async def _show(self, standing: Standing) -> None:
        alarm, word = standing.message, standing.acknowledgement
        known = self._known.get(alarm.id)
        if known is None:
            if not standing.raised:
                return
            known = self._known[alarm.id] = _Condition(await self._generator(alarm), [])
        newly = word is not None and not known.acknowledged
        if standing.raised:
            known.acknowledged = word is not None
        event = known.generator.event
        event.Severity = _SEVERITY.get(alarm.severity, 500)
        event.Message = ua.LocalizedText(alarm.statement)
        event.Comment = ua.LocalizedText(word.note) if word is not None and newly else None
        if word is not None and newly:
            event.ClientUserId = word.name
        event.ActiveState = ua.LocalizedText("Active" if standing.raised else "Inactive")
        setattr(event, "ActiveState/Id", standing.raised)
        event.AckedState = ua.LocalizedText("Acknowledged" if known.acknowledged else "Unacknowledged")
        setattr(event, "AckedState/Id", known.acknowledged)
        event.Retain = standing.raised
        await known.generator.trigger(None if newly else datetime.fromtimestamp(alarm.time / 1e9, UTC))
        event_id = event.EventId
        known.events = [*known.events[-9:], bytes(event_id.Value if isinstance(event_id, ua.Variant) else event_id)]

    async def _generator(self, alarm: Alarm) -> EventGenerator:
        """Make the condition's node and its event generator."""
        server = self._server
        kind = ua.NodeId(ua.ObjectIds.AlarmConditionType)
        node_id = ua.NodeId(f"alarm:{alarm.id}", self._own)
        if node_id not in server.iserver.aspace:
            await self._add_node(node_id, alarm.kind, kind)
        generator = await server.get_event_generator(kind, ua.ObjectIds.Server)
        event = generator.event
        event.NodeId = node_id
        event.SourceNode = self._parent.nodeid
        event.SourceName = alarm.source or "cell"
        event.ConditionName = alarm.kind
        event.ConditionClassId = ua.NodeId(ua.ObjectIds.ProcessConditionClassType)
        event.ConditionClassName = ua.LocalizedText("ProcessConditionClass")
        event.BranchId = ua.NodeId()
        event.Quality = ua.StatusCode()
        event.InputNode = ua.NodeId()
        event.SuppressedOrShelved = False
        event.EnabledState = ua.LocalizedText("Enabled")
        setattr(event, "EnabledState/Id", True)
        return generator

    async def _add_node(self, node_id: ua.NodeId, name: str, kind: ua.NodeId) -> None:
        """Add a component below the cell; the library's own method accepts only its own types."""
        made = ua.AddNodesItem()
        made.RequestedNewNodeId, made.BrowseName = node_id, ua.QualifiedName(name, self._own)
        made.ParentNodeId, made.ReferenceTypeId = self._parent.nodeid, ua.NodeId(ua.ObjectIds.HasComponent)
        made.NodeClass, made.TypeDefinition = ua.NodeClass.Object, kind
        made.NodeAttributes = ua.ObjectAttributes(DisplayName=ua.LocalizedText(name))
        (result,) = await self._server.iserver.isession.add_nodes([made])
        result.StatusCode.check()

    async def _acknowledge(self, condition: ua.NodeId, event: ua.Variant, comment: ua.Variant) -> ua.StatusCode:
        """Acknowledge the alarm of a condition for the user of the session."""
        codes = ua.StatusCodes
        name = str(condition.Identifier).removeprefix("alarm:") if condition.NamespaceIndex == self._own else ""
        known = self._known.get(name)
        if known is None:
            return ua.StatusCode(codes.BadNodeIdUnknown)
        if event.Value not in known.events:
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
