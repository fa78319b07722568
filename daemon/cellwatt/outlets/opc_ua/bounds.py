"""Limits of requests, per client and in total: announced to clients, and enforced before any work."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.user_managers import UserManager

from cellwatt.door.port import Limits, Port
from cellwatt.door.tries import Guard
from cellwatt.outlets.opc_ua.arrays import ENTRIES
from cellwatt.outlets.opc_ua.conditions import USER

CONNECTIONS: Final = Limits(connections=64, peer=32, head=15.0, idle=15.0)
"""A connection whose session is not active after ``head`` s is closed."""
SUBSCRIPTIONS: Final = 128
SUBSCRIPTIONS_OF_SESSION: Final = 8
ITEMS: Final = 2000
"""Most monitored items of one subscription."""
VALUES: Final = 100
"""Most queued values of a monitored item."""
UNACKNOWLEDGED: Final = 100
"""Most messages of a subscription that are held until the client acknowledges them."""
FASTEST, SLOWEST = 20.0, 3_600_000.0
"""Shortest and longest publishing interval, ms."""
REQUEST: Final = 1 << 18
"""Most bytes of a request."""
ANSWER: Final = 1 << 22
"""Most bytes of the values in an answer."""
REFERENCES: Final = 10_000
"""Most references between nodes in an answer."""
CHUNK: Final = 65535
_OPERATIONS: Final = (
    "MaxNodesPerRead", "MaxNodesPerBrowse", "MaxNodesPerTranslateBrowsePathsToNodeIds", "MaxMonitoredItemsPerCall",
    "MaxNodesPerMethodCall", "MaxNodesPerWrite", "MaxNodesPerRegisterNodes", "MaxNodesPerNodeManagement",
)  # fmt: skip
"""Limits of entries, by their name in the standard."""
_CAPABILITIES: Final = {
    "MaxSessions": CONNECTIONS.connections,
    "MaxSubscriptions": SUBSCRIPTIONS,
    "MaxSubscriptionsPerSession": SUBSCRIPTIONS_OF_SESSION,
    "MaxMonitoredItemsPerSubscription": ITEMS,
    "MaxMonitoredItemsQueueSize": VALUES,
}


class BoundedServer(Server):  # type: ignore[misc]
    """A server with all limits of this module; ``counts`` counts what was refused."""

    def __init__(self, users: UserManager) -> None:
        self.counts: Counter[str] = Counter()
        super().__init__(BoundedInternal(Guard("opc_ua", self.counts), user_manager=users))
        chunks = REQUEST // CHUNK + 1
        self.limits = TransportLimits(CHUNK, CHUNK, max_chunk_count=chunks, max_message_size=REQUEST)
        inner = self.iserver
        inner.max_subscriptions = SUBSCRIPTIONS
        inner.max_monitored_item_queue_size = VALUES
        inner.max_unacked_messages_per_subscription = UNACKNOWLEDGED
        inner.max_pending_messages_per_connection = 50
        inner.max_session_timeout_ms = 120_000
        inner.max_pending_activation_seconds = 0  # the port has a deadline for the activation

    async def start(self) -> None:
        """Begin to listen. Raises ``OutletError`` on failure."""
        await self._announce()
        await self._setup_server_nodes()
        await self.iserver.start()
        host, port = self.socket_address
        self.bserver = _Listener(self.iserver, host, port, self.limits, self.counts)
        self.bserver.set_policies(self._policies)
        await self.bserver.start()

    async def _announce(self) -> None:
        """Announce the limits to clients, in the nodes that the standard defines."""
        limits = {f"OperationLimits_{name}": ENTRIES for name in _OPERATIONS} | _CAPABILITIES
        for name, most in limits.items():
            number = ua.NodeId(getattr(ua.ObjectIds, f"Server_ServerCapabilities_{name}"))
            if number in self.iserver.aspace:  # nodes of later editions may be absent
                kind = await self.get_node(number).read_data_type_as_variant_type()
                await self.get_node(number).write_value(ua.Variant(most, kind))


class _Listener(BinaryServer):  # type: ignore[misc]
    """Listens through a ``Port`` with limits."""

    def __init__(
        self, inner: InternalServer, host: str, port: int, limits: TransportLimits, counts: Counter[str]
    ) -> None:
        super().__init__(inner, host, port, limits)
        self._door = Port(self._make_protocol, CONNECTIONS, serving=_serving, counts=counts)

    def _make_protocol(self) -> OPCUAProtocol:
        return _Protocol(self.iserver, self._policies, self.clients, self.closing_tasks, self.limits)

    async def start(self) -> None:
        """Begin to listen. Raises ``OutletError`` on failure."""
        self.port: int = await self._door.open(self.hostname, self.port)
        self.cleanup_task = asyncio.create_task(self._close_task_loop())

    async def stop(self) -> None:
        """Disconnect all clients."""
        await self._door.close()
        await super().stop()


class _Protocol(OPCUAProtocol):  # type: ignore[misc]
    """Buffers no more of an incomplete message than the size of a chunk."""

    def data_received(self, data: bytes) -> None:
        """See ``OPCUAProtocol.data_received``."""
        super().data_received(data)
        if len(self._buffer) > CHUNK and self.transport is not None:
            self.transport.abort()


def _serving(protocol: OPCUAProtocol) -> bool:
    session = protocol.processor.session if protocol.processor is not None else None
    return session is not None and session.is_activated()


class BoundedSession(InternalSession):  # type: ignore[misc]
    """Enforces the limits and knows the user of a method call; no client writes a value or changes nodes."""

    guard: Guard

    def activate_session(self, params: Any, peer_certificate: Any) -> Any:
        """See ``InternalSession.activate_session``; failed logins delay further ones."""
        token = params.UserIdentityToken
        if not self.external or not isinstance(token, ua.UserNameIdentityToken):
            return super().activate_session(params, peer_certificate)
        address, account = str(self.name[0]), token.UserName or ""
        if self.guard.begin(address, account):
            raise ServiceError(ua.StatusCodes.BadUserAccessDenied)
        try:
            result = super().activate_session(params, peer_certificate)
        except Exception:
            self.guard.fail(address, account)
            raise
        self.guard.succeed(address, account)
        return result

    async def read(self, params: Any) -> Any:
        """See ``InternalSession.read``."""
        results = await super().read(params)
        if self.external and sum(_size(result) for result in results) > ANSWER:
            raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        return results

    async def browse(self, params: Any) -> Any:
        """See ``InternalSession.browse``."""
        results: list[Any] = []
        left = REFERENCES
        for node in params.NodesToBrowse:
            results += await super().browse(replace(params, NodesToBrowse=[node]))
            left -= len(results[-1].References)
            if self.external and left < 0:
                raise ServiceError(ua.StatusCodes.BadResponseTooLarge)
        return results

    async def create_subscription(self, params: Any, callback: Any, request_callback: Any = None) -> Any:
        """See ``InternalSession.create_subscription``."""
        if self.external:
            mine = [s for s in self.subscription_service.subscriptions.values() if s.session_id == self.session_id]
            if len(mine) >= SUBSCRIPTIONS_OF_SESSION:
                raise ServiceError(ua.StatusCodes.BadTooManySubscriptions)
            params.RequestedPublishingInterval = min(max(FASTEST, params.RequestedPublishingInterval), SLOWEST)
        return await super().create_subscription(params, callback, request_callback)

    async def create_monitored_items(self, params: Any) -> Any:
        """See ``InternalSession.create_monitored_items``."""
        self._own(params.SubscriptionId)
        there = self.subscription_service.subscriptions.get(params.SubscriptionId)
        known = 0 if there is None else len(there.monitored_item_srv._monitored_items)
        if self.external and known + len(params.ItemsToCreate) > ITEMS:
            raise ServiceError(ua.StatusCodes.BadTooManyMonitoredItems)
        return await super().create_monitored_items(params)

    async def call(self, params: Any) -> Any:
        """See ``InternalSession.call``."""
        token = USER.set(self.user.name if self.user is not None else None)
        try:
            return await super().call(params)
        finally:
            USER.reset(token)

    async def write(self, params: Any) -> Any:
        """Refuse a write from a client."""
        if not self.external:
            return await super().write(params)
        return [ua.StatusCode(ua.StatusCodes.BadNotWritable) for _ in params.NodesToWrite]

    def _own(self, *subscriptions: int) -> None:
        """Refuse requests about subscriptions of other sessions: their numbers can be guessed."""
        there = self.subscription_service.subscriptions
        if self.external and any(n in there and there[n].session_id != self.session_id for n in subscriptions):
            raise ServiceError(ua.StatusCodes.BadSubscriptionIdInvalid)


async def _unsupported(_: BoundedSession, __: Any) -> Any:
    """Refuse: answers are never split, so nothing is continued, and history is in the recordings."""
    raise ServiceError(ua.StatusCodes.BadServiceUnsupported)


def _of_own(name: str, subscriptions: Callable[[Any], Sequence[int]]) -> None:
    """Allow a session to call a service for its own subscriptions only."""

    async def bounded(self: BoundedSession, params: Any) -> Any:
        self._own(*subscriptions(params))
        return await getattr(super(BoundedSession, self), name)(params)

    setattr(BoundedSession, name, bounded)


_of_own("modify_monitored_items", lambda params: (params.SubscriptionId,))
_of_own("delete_monitored_items", lambda params: (params.SubscriptionId,))
_of_own("set_monitoring_mode", lambda params: (params.SubscriptionId,))
_of_own("set_publishing_mode", lambda params: params.SubscriptionIds)
_of_own("delete_subscriptions", lambda ids: ids)
BoundedSession.browse_next = BoundedSession.history_read = _unsupported


def _size(value: Any) -> int:
    """Lower bound of a value's size, bytes, without encoding it."""
    inner = value.Value.Value if value.Value is not None else None
    return len(inner) if isinstance(inner, str | bytes | list) else 8


class BoundedInternal(InternalServer):  # type: ignore[misc]
    """Makes sessions with users and limits; one connection has one session."""

    def __init__(self, guard: Guard, **more: Any) -> None:
        self._guard = guard
        self._closing: set[asyncio.Task[None]] = set()
        super().__init__(**more)

    def create_session(self, name: Any, user: Any = None, external: bool = False) -> BoundedSession:
        """See ``InternalServer.create_session``."""
        if external:
            for session in [each for each in self._external_sessions.values() if each.name == name]:
                self._external_sessions.pop(session.auth_token)
                task = asyncio.create_task(session.close_session(True))
                self._closing.add(task)
                task.add_done_callback(self._closing.discard)
        user = User(role=UserRole.Anonymous) if user is None else user
        made = BoundedSession(self, self.aspace, self.subscription_service, name, user=user, external=external)
        made.guard = self._guard
        return made
