"""Subscribes to tags of an OPC UA server."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field, FilePath, SecretStr, model_validator

from cellwatt.channel import Stream
from cellwatt.config.wording import did_you_mean
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import ConfigError, ConnectError, DeviceError
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.opc_ua import messages
from cellwatt_drivers.opc_ua.certificates import Credentials
from cellwatt_drivers.opc_ua.intake import Intake
from cellwatt_drivers.opc_ua.nodes import Search, Source
from cellwatt_drivers.opc_ua.session import Access, SecurityMode, Session, open_session
from cellwatt_drivers.opc_ua.subscribing import Subscribed, subscribe
from cellwatt_drivers.opc_ua.tag_map import (
    ModelName,
    Prefix,
    Tag,
    TagMap,
    check_prefixes,
    load_map,
    packaged_map,
)
from cellwatt_drivers.shared.choice import Chosen
from cellwatt_drivers.shared.maps import ChannelName
from cellwatt_drivers.shared.requirements import require

if TYPE_CHECKING:
    from asyncua import ua

PORT = 4840
_WAY = 0.005
"""s that a message takes at most from the server to here, where nothing is in the way."""


class OpcUaSettings(SourceSettings):
    """A PLC or robot controller with an OPC UA server. It is read by a subscription; nothing is written."""

    device_parts: ClassVar[tuple[str, ...]] = ("path",)

    host: Host
    """Address of the server."""
    port: int = Field(PORT, ge=1, le=65535)
    """TCP port."""
    path: str = ""
    """Path of the endpoint's URL, for servers that have one: ``/UA/Server``."""
    model: ModelName | None = None
    """A packaged map of tags: ``opc_40010`` for any robot with the types of OPC UA for Robotics."""
    map: FilePath | None = None
    """File with a map of one's own instead of ``model``."""
    tags: dict[ChannelName, Tag] = Field(default_factory=dict)
    """Tags by channel, in place of a map or beside it."""
    namespaces: dict[Prefix, str] = Field(default_factory=dict)
    """Namespace URIs by the prefix that ``tags`` use."""
    read: Chosen[str] | None = None
    """Channels to read; left out: all."""
    rate: Hertz = Field(10.0, gt=0, le=1000)
    """Samples a second that the server shall take."""
    publish: Seconds = Field(0.1, gt=0)
    """The server sends what changed this often."""
    queue: int | None = Field(None, ge=1, le=10_000)
    """Values of each tag that the server keeps until it sends them; left out: those of 2 s, at least 10."""
    every_sample: bool = False
    """Have also unchanged values sent, by their time stamps; not every server can."""
    time: Literal["source", "server"] = "source"
    """Time stamps to use: the ``source``'s, or the ``server``'s where the source gives none."""
    security: SecurityMode = "none"
    """Policy Basic256Sha256 with messages that are signed (``sign``), or signed and encrypted (``encrypt``)."""
    certificate: FilePath | None = None
    """This PC's certificate (PEM or DER) with an application URI; the server must trust it."""
    key: FilePath | None = None
    """Private key of ``certificate``."""
    key_password: SecretStr | None = None
    """Password of ``key``."""
    server_certificate: FilePath | None = None
    """Certificate that the server must have; left out: the one that it shows is taken."""
    user: str | None = None
    """User to log in; left out: none."""
    password: SecretStr = SecretStr("")
    """Its password, best as ``${OPC_UA_PASSWORD}``."""
    user_certificate: FilePath | None = None
    """Certificate (PEM or DER) of the user to log in, in place of ``user``; the server must know it."""
    user_key: FilePath | None = None
    """Private key of ``user_certificate``."""
    user_key_password: SecretStr | None = None
    """Password of ``user_key``."""
    unencrypted: bool = False
    """Send the password even where nothing encrypts it."""
    timeout: Seconds = Field(4.0, gt=0)
    """Wait this long for an answer."""
    silence: Seconds = Field(5.0, gt=0)
    """No message for this long, not even a sign of life: the session is opened anew."""

    @model_validator(mode="after")
    def _fits(self) -> OpcUaSettings:
        if self.model is not None and self.map is not None:
            raise ValueError("write 'model' (a packaged map) or 'map' (a file), not both")
        if self.model is None and self.map is None and not self.tags:
            raise ValueError("write 'model' (a packaged map), 'map' (a file) or 'tags'")
        if self.path and not self.path.startswith("/"):
            raise ValueError("'path' begins with a slash, like /UA/Server")
        if self.security != "none" and (self.certificate is None or self.key is None):
            raise ValueError(f"'security: {self.security}' needs 'certificate' and 'key'")
        if self.security == "none" and (self.certificate or self.key or self.server_certificate):
            raise ValueError("certificates are used with 'security: sign' or 'security: encrypt'")
        if (self.user_certificate is None) != (self.user_key is None):
            raise ValueError("'user_certificate' and 'user_key' are needed together")
        if self.user_certificate is not None and (self.user is not None or self.security == "none"):
            raise ValueError("'user_certificate' needs 'security: sign' or 'security: encrypt', and no 'user'")
        if self.publish * 2 > self.silence:
            raise ValueError(f"'silence' is at least twice 'publish' ({2 * self.publish:g} s)")
        check_prefixes(self.tags, self.namespaces)
        return self

    @property
    def queue_size(self) -> int:
        """Values of each tag that the server is asked to keep."""
        return self.queue or max(10, math.ceil(2.0 * self.rate))


class OpcUaDriver(Driver[OpcUaSettings]):
    """One server. A tag is sampled ``rate`` times a second by the server, and told when it changes.

    Samples carry the source's time stamps. A sample in which nothing changed is handed over with the values before.
    """

    Settings = OpcUaSettings
    libraries = ("asyncua",)
    title = "PLCs and robots with an OPC UA server (FANUC, KUKA, Siemens, ABB, B&R, own maps)"
    emulator = "cellwatt_drivers.opc_ua.emulator:OpcUaEmulator"
    writes = (
        "OPC UA services that read: GetEndpoints, Browse, BrowseNext, TranslateBrowsePathsToNodeIds, Read",
        "session and subscription: OpenSecureChannel, CreateSession, ActivateSession, CreateSubscription, "
        "CreateMonitoredItems, Publish, CloseSession, CloseSecureChannel; never Write, Call or HistoryUpdate",
    )

    def __init__(self, name: str, settings: OpcUaSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        require(name, "driver opc_ua", {"asyncua": "the package asyncua"}, "pip install 'cellwatt[opc-ua]'")
        self._map = _map(settings)
        self._tags = _chosen(self._map, settings.read)
        channels = tuple(tag.channel(channel) for channel, tag in self._tags.items())
        self._stream = Stream("tags", channels, settings.rate, "device")
        self._intake = Intake(name, inlet, self._stream, _status_name)
        # The newest sample of a message is this old at most, and always so where sampling and sending beat together.
        vars(self)["least_delay"] = (0.0, min(settings.publish, 1 / settings.rate) + _WAY)
        self._dropped = 0

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One: ``tags``."""
        return (self._stream,)

    @property
    def url(self) -> str:
        """The endpoint's URL."""
        s = self.settings
        host = f"[{s.host}]" if ":" in s.host else s.host
        return f"opc.tcp://{host}:{s.port}{s.path}"

    async def identify(self) -> Identity:
        """See ``Driver.identify``: the server's build information, once all tags were found."""
        async with open_session(self._access()) as session:
            sources, lacking = await self._find(session)
            return await self._identity(session, sources, lacking)

    async def run(self) -> None:
        """See ``Driver.run``."""
        s = self.settings
        async with open_session(self._access()) as session:
            sources, lacking = await self._find(session)
            identity = await self._identity(session, sources, lacking)
            made = await subscribe(session, s.rate, s.publish, s.silence, s.queue_size, s.every_sample, sources)
            self._tell_revised(made)
            self.inlet.connected(identity)
            self._intake.resume(made.sampling, made.publishing)
            self._dropped = 0
            while True:
                await self._take(session, made)

    async def _take(self, session: Session, made: Subscribed) -> None:
        silence = max(self.settings.silence, 2 * made.life_sign)
        published = await session.feed.given(silence)
        if not published:
            raise ConnectError(f"{self.url}: no sign of life of the subscription for {silence:g} s")
        arrival = self.inlet.now()
        if session.feed.dropped > self._dropped:
            self.inlet.account.anomaly("messages dropped", session.feed.dropped - self._dropped)
            self._dropped = session.feed.dropped
        for result in published:
            message = messages.read(result, made.sources, self.settings.time == "server")
            if message.ended:
                raise DeviceError(f"{self.url}: the server ended the subscription: {message.ended}")
            self._intake.take(message, arrival)
        await asyncio.sleep(0)

    def _access(self) -> Access:
        s = self.settings
        credentials = None
        if s.security != "none":
            assert s.certificate is not None and s.key is not None
            password = s.key_password.get_secret_value() if s.key_password else None
            credentials = Credentials(s.certificate, s.key, password, s.server_certificate)
        password = s.password.get_secret_value()
        user = None
        if s.user_certificate is not None and s.user_key is not None:
            secret = s.user_key_password.get_secret_value() if s.user_key_password else None
            user = Credentials(s.user_certificate, s.user_key, secret)
        return Access(self.url, s.security, credentials, s.user, password, s.unencrypted, s.timeout, user)

    async def _find(self, session: Session) -> tuple[list[Source], list[str]]:
        sources, lacking = await Search(session, self.url, self._map.namespaces).find(self._tags)
        if not sources:
            raise DeviceError(f"{self.url} has none of the tags: {', '.join(lacking)}")
        if lacking and frozenset(lacking) != self.left_out:
            told = ", ".join(lacking)
            self.inlet.event("tags_missing", f"{self.name}: not there, and left out: {told}", channels=told)
        self.left_out = frozenset(lacking)
        return sources, lacking

    async def _identity(self, session: Session, sources: list[Source], lacking: list[str]) -> Identity:
        from asyncua import ua

        (answer,) = await session.read([ua.NodeId(ua.ObjectIds.Server_ServerStatus)], ua.AttributeIds.Value)
        status: Any = answer.Value.Value if answer.Value is not None else None
        state = getattr(status, "State", None)
        if state is not None and int(state) != int(ua.ServerState.Running):
            raise DeviceError(f"{self.url}: the server says that it is not running: {ua.ServerState(state).name}")
        build = getattr(status, "BuildInfo", None)
        notes = {
            "map": self._map.source,
            "nodes": str(len({s.node for s in sources})),
            "security": self.settings.security,
        }
        notes |= {"not there": ", ".join(lacking)} if lacking else {}
        notes |= {"certificate (SHA-256)": session.thumbprint} if session.thumbprint else {}
        if getattr(status, "StartTime", None):
            notes["started"] = status.StartTime.isoformat(timespec="seconds")
        return Identity(
            self._map.maker or str(getattr(build, "ManufacturerName", "") or "unknown maker"),
            self._map.model or str(getattr(build, "ProductName", "") or "OPC UA server"),
            firmware=str(getattr(build, "SoftwareVersion", "") or ""),
            notes=notes,
        )

    def _tell_revised(self, made: Subscribed) -> None:
        """Report where the server does not do what it was asked for."""
        s = self.settings
        told = []
        if made.sampling > 1.01 / s.rate:
            told.append(f"samples every {made.sampling:g} s instead of every {1 / s.rate:g} s")
        if made.publishing > 1.01 * s.publish:
            told.append(f"sends every {made.publishing:g} s instead of every {s.publish:g} s")
        if made.queue < min(s.queue_size, made.publishing * s.rate):
            told.append(f"keeps {made.queue} values of each tag instead of {s.queue_size}")
        if made.without_filter:
            told.append("cannot send every sample")
        if told:
            self.inlet.event("revised", f"{self.name}: the server {', and '.join(told)}")


def _status_name(code: int) -> str:
    from asyncua import ua

    status: ua.StatusCode = ua.StatusCode(code & 0xFFFF_0000)
    return str(status.name)


def _map(settings: OpcUaSettings) -> TagMap:
    if settings.map is not None:
        made = load_map(settings.map)
    elif settings.model is not None:
        made = packaged_map(settings.model)
    else:
        return TagMap(source="settings", namespaces=settings.namespaces, values=settings.tags)
    if not settings.tags:
        return made
    both = {"values": made.values | settings.tags, "namespaces": made.namespaces | settings.namespaces}
    return made.model_copy(update=both)


def _chosen(made: TagMap, read: tuple[str, ...] | None) -> Mapping[str, Tag]:
    """Return the tags to read. Raises ``ConfigError`` where there is no such channel."""
    if read is None:
        return made.values
    for name in read:
        if name not in made.values:
            raise ConfigError(f"read: no tag gives {name!r}{did_you_mean(name, made.values)}")
    return {name: made.values[name] for name in read}
