"""A read-only session with an OPC UA server: opened, kept alive and closed."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar

from cellwatt.errors import DeviceError, SourceError
from cellwatt_drivers.opc_ua.browse_path import Child
from cellwatt_drivers.opc_ua.certificates import application_uri, certificate_of, key_of
from cellwatt_drivers.opc_ua.complaints import Complaints
from cellwatt_drivers.opc_ua.settings import OpcUaSettings
from cellwatt_drivers.shared.mailbox import Mailbox

if TYPE_CHECKING:
    from asyncua import Client, ua

T = TypeVar("T")
R = TypeVar("R")

_AT_ONCE: Final = 100
"""Most nodes per request; fewer if the server refuses so many."""
_MOST_WAITING: Final = 1000
"""Most published messages queued for the driver."""
_FAREWELL: Final = 0.5
"""Longest time to close a session, s."""
_RENEWED_AFTER: Final = 0.75
"""Share of a channel's lifetime after which its keys are renewed."""
_LIFE_OF_SESSION: Final = 60_000
"""Time-out, ms, after which a server may end the session of a silent client."""


class Session:
    """An open session; ``open_session`` creates it. All methods raise ``SourceError``."""

    def __init__(self, client: Client, complaints: Complaints) -> None:
        self.complaints = complaints
        self.feed: Mailbox[ua.PublishResult] = Mailbox(_MOST_WAITING)
        self._client = client
        self._at_once = _AT_ONCE

    @property
    def thumbprint(self) -> str:
        """SHA-256 of the server's certificate; empty without one."""
        import hashlib

        certificate = self._client.security_policy.peer_certificate
        return hashlib.sha256(certificate).hexdigest() if certificate else ""

    async def read(self, nodes: Sequence[ua.NodeId], attribute: ua.AttributeIds) -> list[ua.DataValue]:
        """Read one attribute of each node."""
        ask = self._client.uaclient.read_attributes
        return await self._in_parts("reading", nodes, lambda part: ask(part, attribute))

    async def value(self, number: int) -> Any:
        """Value of a standard node; ``None`` if it has no value."""
        from asyncua import ua

        (found,) = await self.read([ua.NodeId(number)], ua.AttributeIds.Value)
        return found.Value.Value if found.Value is not None else None

    async def children(self, node: str) -> list[Child]:
        """Return the children of a node."""
        from asyncua import ua

        with self.complaints.about(f"browsing {node}"):
            references = await self._client.get_node(node).get_references(
                ua.ObjectIds.HierarchicalReferences, ua.BrowseDirection.Forward
            )
        return [
            Child(
                str(r.BrowseName.Name),
                int(r.BrowseName.NamespaceIndex),
                r.NodeId.to_string(),
                r.NodeClass == ua.NodeClass.Object,
            )
            for r in references
        ]

    async def properties(self, nodes: Sequence[ua.NodeId], name: str) -> list[Any]:
        """Read the property with this name of each node; ``None`` for nodes without it."""
        from asyncua import ua

        paths = [_property_path(node, name) for node in nodes]
        ask = self._client.uaclient.translate_browsepaths_to_nodeids
        answer = await self._in_parts("reading properties", paths, ask)
        targets = [r.Targets[0].TargetId if r.StatusCode.is_good() and r.Targets else None for r in answer]
        present = [t for t in targets if t is not None]
        values = iter(await self.read(present, ua.AttributeIds.Value))
        found = [next(values) if t is not None else None for t in targets]
        return [v.Value.Value if v is not None and v.Value is not None else None for v in found]

    async def subscribe(self, wanted: ua.CreateSubscriptionParameters) -> ua.CreateSubscriptionResult:
        """Create a subscription; its messages go to ``feed``."""
        with self.complaints.about("subscribing"):
            return await self._client.uaclient.create_subscription(wanted, self.feed.take)

    async def monitor(
        self, subscription: int, items: Sequence[ua.MonitoredItemCreateRequest]
    ) -> list[ua.MonitoredItemCreateResult]:
        """Create monitored items of a subscription."""
        from asyncua import ua

        create, both = self._client.uaclient.create_monitored_items, ua.TimestampsToReturn.Both
        wanted = partial(ua.CreateMonitoredItemsParameters, subscription, both)
        return await self._in_parts("subscribing", items, lambda part: create(wanted(part)))

    async def _in_parts(
        self, doing: str, items: Sequence[T], ask: Callable[[list[T]], Awaitable[Sequence[R]]]
    ) -> list[R]:
        """Return one answer per item, requested in batches that the server accepts."""
        from asyncua.ua.uaerrors import BadTooManyOperations

        found: list[R] = []
        while len(found) < len(items):
            part = list(items[len(found) :][: self._at_once])
            with self.complaints.about(doing):
                try:
                    answer = await ask(part)
                except BadTooManyOperations:
                    if len(part) == 1:
                        raise
                    self._at_once = len(part) // 2
                    continue
            if len(answer) != len(part):
                raise self.complaints.strange(f"{len(answer)} values for {len(part)} nodes")
            found += answer
        return found

    async def renew(self) -> None:
        """Renew the channel's keys as long as it is open; a failure is passed to ``feed``."""
        while True:
            await asyncio.sleep(self._client.secure_channel_timeout * 1e-3 * _RENEWED_AFTER)
            try:
                with self.complaints.about("renewing the secure channel"):
                    await self._client.open_secure_channel(renew=True)
                    # The library compares the server's time, which may be years off, with this PC's.
                    self._client.uaclient.protocol._connection.security_token.CreatedAt = datetime.now(UTC)
                    self._client.uaclient.revolve_security_token()
            except SourceError as error:
                self.feed.fail(error)
                return


@asynccontextmanager
async def open_session(settings: OpcUaSettings) -> AsyncIterator[Session]:
    """Open a session and close it at the end. Raises ``SourceError``."""
    from asyncua import Client

    from cellwatt.outlets.opc_ua.arrays import bound_arrays

    bound_arrays()
    logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)  # it logs errors that are raised here
    client = Client(settings.url, timeout=settings.timeout)
    client.name = client.description = "cellwatt"
    client.session_timeout = _LIFE_OF_SESSION
    by_certificate = settings.user_certificate.name if settings.user_certificate else ""
    complaints = Complaints(settings.url, settings.user or by_certificate)
    try:
        await _connect(client, settings, complaints)
        session = Session(client, complaints)
        _watch(client, session)
        renewing = asyncio.create_task(session.renew())
        try:
            yield session
        finally:
            renewing.cancel()
            await asyncio.wait([renewing])
    finally:
        await _farewell(client)


async def _connect(client: Client, settings: OpcUaSettings, complaints: Complaints) -> None:
    user, password = settings.user, settings.password.get_secret_value()
    if settings.security != "none":
        await _secure(client, settings, complaints)
    with complaints.about("connecting"):
        await client.connect_socket()
    with complaints.about("opening the secure channel"):
        await client.send_hello()
        await client.open_secure_channel()
    with complaints.about("opening a session"):
        await client.create_session()
    certificate = None
    if settings.user_certificate is not None and settings.user_key is not None:
        certificate = await asyncio.to_thread(certificate_of, settings.user_certificate)
        client.user_private_key = await asyncio.to_thread(key_of, settings.user_key, settings.user_key_password)
    if user is not None:
        _refuse_unencrypted(client, settings)
        client.set_user(user)
        client.set_password(password)
    with complaints.about("logging in"):
        await client.activate_session(username=user, password=password, certificate=certificate)


async def _secure(client: Client, settings: OpcUaSettings, complaints: Complaints) -> None:
    """Set policy and certificates; requests the server's certificate unless it is pinned."""
    from asyncua import ua
    from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256 as Policy
    from asyncua.crypto.uacrypto import x509_from_der
    from cryptography.hazmat.primitives import hashes

    path, pinned = settings.certificate, settings.server_certificate
    assert path is not None and settings.key is not None
    certificate = await asyncio.to_thread(certificate_of, path)
    key = await asyncio.to_thread(key_of, settings.key, settings.key_password)
    client.application_uri = application_uri(path, certificate)
    complaints.certificate = certificate.fingerprint(hashes.SHA1()).hex()
    mode = {"sign": ua.MessageSecurityMode.Sign, "encrypt": ua.MessageSecurityMode.SignAndEncrypt}[settings.security]
    server = await asyncio.to_thread(certificate_of, pinned) if pinned else None
    if server is None:
        with complaints.about("asking for its endpoints"):
            endpoints = await client.connect_and_get_server_endpoints()
        offered = {(e.SecurityPolicyUri.rpartition("#")[2], e.SecurityMode.name.rstrip("_")): e for e in endpoints}
        chosen = offered.get(("Basic256Sha256", mode.name))
        if chosen is None:
            offers = ", ".join(sorted({f"{policy} {name}" for policy, name in offered})) or "nothing"
            raise DeviceError(f"{settings.url} offers no Basic256Sha256 {mode.name}; it offers: {offers}")
        server = x509_from_der(chosen.ServerCertificate)
    with complaints.about("using the certificates"):
        client.security_policy = Policy(server, certificate, key, mode)
        client.uaclient.set_security(client.security_policy)


def _refuse_unencrypted(client: Client, settings: OpcUaSettings) -> None:
    """Raise ``DeviceError`` if the password would be sent in plain text."""
    from asyncua import ua

    policy = client.server_policy(ua.UserTokenType.UserName).SecurityPolicyUri or ""
    plain = not policy or policy.endswith("#None")
    if plain and settings.security != "encrypt" and not settings.unencrypted:
        raise DeviceError(
            f"{settings.url} accepts the password in plain text only: write 'security: encrypt', or 'unencrypted: "
            "true' if no one else uses this network"
        )


def _watch(client: Client, session: Session) -> None:
    """Notify the session's feed when the connection is lost."""
    protocol = client.uaclient.protocol
    if protocol is None:
        raise session.complaints.gone()
    known = protocol.on_connection_lost

    def lost(error: Exception | None) -> None:
        session.feed.fail(session.complaints.gone())
        if known is not None:
            known(error)

    protocol.on_connection_lost = lost
    if protocol.is_closed:
        session.feed.fail(session.complaints.gone())


async def _farewell(client: Client) -> None:
    """Close session, channel and socket, as far as they were opened."""
    protocol = client.uaclient.protocol
    with suppress(Exception):  # the connection is closed whatever fails
        async with asyncio.timeout(_FAREWELL):
            await client.close_session()
            await client.close_secure_channel()
    client.disconnect_socket()
    if protocol is not None and protocol.transport is not None:
        protocol.transport.abort()
    for _ in range(2):  # closed transports and cancelled tasks end at the loop's next turns
        await asyncio.sleep(0)


def _property_path(node: ua.NodeId, name: str) -> ua.BrowsePath:
    from asyncua import ua

    kind = ua.NodeId(ua.ObjectIds.HasProperty)
    element = ua.RelativePathElement(kind, IsInverse=False, IncludeSubtypes=True, TargetName=ua.QualifiedName(name, 0))
    return ua.BrowsePath(node, ua.RelativePath([element]))
