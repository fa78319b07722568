"""Subscribes to tags of an OPC UA server."""

from __future__ import annotations

import asyncio
from typing import Any

from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet
from cellwatt.errors import ConnectError, DeviceError
from cellwatt_drivers.opc_ua import messages
from cellwatt_drivers.opc_ua.intake import Intake
from cellwatt_drivers.opc_ua.nodes import Search, TagPlace
from cellwatt_drivers.opc_ua.session import Session, open_session
from cellwatt_drivers.opc_ua.settings import OpcUaSettings
from cellwatt_drivers.opc_ua.subscribing import Subscribed, subscribe
from cellwatt_drivers.shared.choice import among
from cellwatt_drivers.shared.requirements import require

_WAY = 0.005
"""Longest delay, s, of a message from the server to the daemon on a free network."""
_REMOVED = "the server has removed nodes (BadNodeIdUnknown): was its program changed?"
_LOOKS = 2
"""Consecutive looks at which a value has changed and was not published in between."""


class OpcUaDriver(Driver[OpcUaSettings]):
    """One server. It samples each tag ``rate`` times a second and publishes a tag when its value changes.

    Samples carry the source's time stamps. A sample in which no tag changed repeats the previous values.
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
        self._map = settings.tag_map
        self._tags = {name: self._map.values[name] for name in among(settings.read, self._map.values, "the map")}
        channels = tuple(tag.channel(channel) for channel, tag in self._tags.items())
        self._stream = Stream("tags", channels, settings.rate, "device")
        self._intake = Intake(name, inlet, self._stream)
        self._heard: set[int] = set()
        """Columns that were published since the last look."""
        self._seen: dict[int, tuple[str, int]] = {}
        """Value at the last look, and number of changes without publication, by the node's first column."""
        # The newest sample of a message is at most this old, and always this old if sampling and sending run in step.
        vars(self)["least_delay"] = (0.0, min(settings.publish, 1 / settings.rate) + _WAY)

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The one stream, ``tags``."""
        return (self._stream,)

    async def identify(self) -> Identity:
        """See ``Driver.identify``: the server's build information, after all tags were found."""
        async with open_session(self.settings) as session:
            sources, lacking = await self._find(session)
            return await self._identity(session, sources, lacking)

    async def run(self) -> None:
        """See ``Driver.run``."""
        async with open_session(self.settings) as session:
            sources, lacking = await self._find(session)
            identity = await self._identity(session, sources, lacking)
            made = await subscribe(session, self.settings, sources)
            if revised := made.revised(self.settings):
                self.inlet.event("revised", f"{self.name}: the server {', and '.join(revised)}")
            self.inlet.connected(identity)
            self._intake.resume(made.sampling, made.publishing)
            self._seen.clear()
            loop, pause = asyncio.get_running_loop(), max(self.settings.silence, 3 * made.sampling, 3 * made.publishing)
            while True:
                look = loop.time() + pause
                while loop.time() < look:
                    await self._take(session, made)
                await self._look(session, made)

    async def _take(self, session: Session, made: Subscribed) -> None:
        url, silence = self.settings.url, max(self.settings.silence, 2 * made.life_sign)
        published = await session.feed.given(silence)
        if not published:
            raise ConnectError(f"{url}: no keep-alive of the subscription for {silence:g} s")
        arrival = self.inlet.now()
        self.inlet.account.anomaly("messages dropped", session.feed.dropped)
        session.feed.dropped = 0
        for result in published:
            message = messages.read(result, made.sources, self.settings.time == "server")
            if message.ended:
                raise DeviceError(f"{url}: the server ended the subscription: {message.ended}")
            self._intake.take(message, arrival)
            self._heard.update(item.column for item in message.items)
            if any(item.unknown for item in message.items):  # it stays so, even if a new node has the same id
                raise DeviceError(f"{url}: {_REMOVED}")
        await asyncio.sleep(0)

    async def _look(self, session: Session, made: Subscribed) -> None:
        """Raise ``DeviceError`` if a node is gone, or changes without being published: the subscription is dead."""
        from asyncua import ua

        url, places = self.settings.url, [places[0] for places in made.sources.values()]
        values = await session.read([place.node for place in places], ua.AttributeIds.Value)
        for place, value in zip(places, values, strict=True):
            if value.StatusCode is not None and value.StatusCode.name == "BadNodeIdUnknown":
                raise DeviceError(f"{url}: {_REMOVED}")
            now, (before, changes) = repr(value.Value), self._seen.get(place.column, ("", -1))
            changes = changes + 1 if now != before and place.column not in self._heard else 0
            self._seen[place.column] = now, changes
            if changes >= _LOOKS:
                raise DeviceError(f"{url}: {place.node.to_string()} changes, but the server no longer publishes it")
        self._heard.clear()

    async def _find(self, session: Session) -> tuple[list[TagPlace], list[str]]:
        sources, lacking = await Search(session, self.settings.url, self._map.namespaces).find(self._tags)
        absent = ", ".join(lacking)
        if not sources:
            raise DeviceError(f"{self.settings.url} has none of the tags: {absent}")
        if lacking and frozenset(lacking) != self.left_out:
            self.inlet.event("tags_missing", f"{self.name}: absent, and left out: {absent}", channels=absent)
        self.left_out = frozenset(lacking)
        return sources, lacking

    async def _identity(self, session: Session, sources: list[TagPlace], lacking: list[str]) -> Identity:
        from asyncua import ua

        status: Any = await session.value(ua.ObjectIds.Server_ServerStatus)
        state = getattr(status, "State", None)
        if state is not None and int(state) != int(ua.ServerState.Running):
            raise DeviceError(
                f"{self.settings.url}: the server reports that it is not running: {ua.ServerState(state).name}"
            )
        build, started = getattr(status, "BuildInfo", None), getattr(status, "StartTime", None)
        notes = {
            "map": self._map.source,
            "nodes": str(len({s.node for s in sources})),
            "security": self.settings.security,
            "not there": ", ".join(lacking),
            "certificate (SHA-256)": session.thumbprint,
            "started": started.isoformat(timespec="seconds") if started else "",
        }
        return Identity(
            self._map.maker or str(getattr(build, "ManufacturerName", "") or "unknown maker"),
            self._map.model or str(getattr(build, "ProductName", "") or "OPC UA server"),
            firmware=str(getattr(build, "SoftwareVersion", "") or ""),
            notes={key: note for key, note in notes.items() if note},
        )
