"""An OPC UA server with the nodes of a tag map; the emulator sets their values."""

from __future__ import annotations

import asyncio
import copy
import logging
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

from asyncua import Node, Server, ua
from asyncua.server.address_space import AddressSpace, NodeData, NodeManagementService
from asyncua.server.internal_server import InternalServer

from cellwatt.outlets.opc_ua.access import Users, trust_only
from cellwatt_drivers.opc_ua.messages import EPOCH
from cellwatt_drivers.opc_ua.tag_map import Tag, TagMap, prefix_of
from cellwatt_drivers.shared.maps import KNOWN

_POLICIES = {
    "none": ua.SecurityPolicyType.NoSecurity,
    "sign": ua.SecurityPolicyType.Basic256Sha256_Sign,
    "encrypt": ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
}
_TURNS = 3


@dataclass(frozen=True)
class Entry:
    """Access: security modes, the server's files, the only trusted client's certificate, and a user."""

    modes: tuple[str, ...] = ("none",)
    certificate: Path | None = None
    key: Path | None = None
    trusted: Path | None = None
    user: str = ""
    password: str = ""


@dataclass
class Variable:
    """A variable and its channels, with factor and zero of each from SI units to the node's value."""

    node: Node
    parts: list[tuple[str, float, float, tuple[int, ...]]] = field(default_factory=list)

    def value(self, world: Mapping[str, float]) -> float | list[Any]:
        """Return its value; 0 for channels that the world lacks."""
        found = {index: (world.get(name, 0.0) + zero) / factor for name, factor, zero, index in self.parts}
        return _nested(found, tuple(max(along) + 1 for along in zip(*found, strict=True)))


def _nested(
    found: Mapping[tuple[int, ...], float], shape: tuple[int, ...], at: tuple[int, ...] = ()
) -> float | list[Any]:
    """Return the values by their indices as nested arrays; 0 for an index without a value."""
    if len(at) == len(shape):
        return found.get(at, 0.0)
    return [_nested(found, shape, (*at, i)) for i in range(shape[len(at)])]


class EmulatedServer:
    """The server; ``open`` starts it."""

    def __init__(self, made: TagMap, entry: Entry) -> None:
        self.port = 0
        self.variables: dict[str, Variable] = {}
        """Variables by the text of their node ids."""
        self._map = made
        self._entry = entry
        users = {entry.user: entry.password} if entry.user else {}
        self._server = Server(_Internal(user_manager=Users(users)))

    async def open(self) -> None:
        """Create the nodes and listen at a free port of this host."""
        logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)
        server, entry = self._server, self._entry
        await server.init()
        server.disable_clock()
        server.set_endpoint("opc.tcp://127.0.0.1:0")
        server.set_server_name("emulated controller")
        await server.set_build_info("urn:emulated", "cellwatt", "emulated controller", "1.0", "1", datetime.now(UTC))
        server.set_security_policy([_POLICIES[mode] for mode in entry.modes])
        if entry.certificate is not None and entry.key is not None:
            await server.load_certificate(entry.certificate, "pem")
            await server.load_private_key(entry.key, format="pem")
        if entry.user:
            server.set_identity_tokens([ua.UserNameIdentityToken])
        if entry.trusted is not None:
            await trust_only(server, [entry.trusted])
        for uri in self._map.namespaces.values():
            await server.register_namespace(uri)
        for name, tag in self._map.values.items():
            await self._add(name, tag)
            await asyncio.sleep(0)
        await server.start()
        assert server.bserver is not None
        self.port = int(server.bserver.port)

    async def close(self) -> None:
        """Disconnect all clients and free the port."""
        await self.forget()
        await self._server.stop()
        await asyncio.sleep(0)

    async def forget(self) -> None:
        """Disconnect all clients and end their sessions, which the library would otherwise retain."""
        for transport in list(self._server.iserver.asyncio_transports):
            transport.abort()
        for _ in range(_TURNS):
            await asyncio.sleep(0)
        for session in list(self._server.iserver._external_sessions.values()):
            await session.close_session(True)

    async def set(self, world: Mapping[str, float], stamp: int, status: int) -> None:
        """Set all variables from a world in SI units, with a time stamp, ns UTC, and a status."""
        moment = EPOCH + timedelta(microseconds=stamp // 1000)
        for variable in self.variables.values():
            value = ua.DataValue(
                ua.Variant(variable.value(world), ua.VariantType.Double),
                StatusCode=ua.StatusCode(status),
                SourceTimestamp=moment,
                ServerTimestamp=moment,
            )
            await self._server.write_attribute_value(variable.node.nodeid, value)

    async def _add(self, name: str, tag: Tag) -> None:
        _, unit = KNOWN[tag.unit]
        node = await (self._at_path(tag) if tag.path else self._with_id(tag))
        text = node.nodeid.to_string()
        if text not in self.variables:
            self.variables[text] = Variable(node)
            if tag.server_unit:
                information = ua.EUInformation(DisplayName=ua.LocalizedText(tag.unit), UnitId=-1)
                await node.add_property(0, "EngineeringUnits", information)
        variable = self.variables[text]
        variable.parts.append((name, tag.scale * unit.factor, unit.zero * unit.factor, tag.indices))
        await node.write_value(ua.Variant(variable.value({}), ua.VariantType.Double))

    async def _with_id(self, tag: Tag) -> Node:
        """Return the variable with a tag's node id, created below Objects."""
        server, text = self._server, tag.node or ""
        rest = text.partition(";")[2] or text
        if (prefix := prefix_of(text)) is not None:
            text = f"ns={await server.get_namespace_index(self._map.namespaces[prefix])};{rest}"
        elif text.startswith("nsu="):
            text = f"ns={await server.register_namespace(text.removeprefix('nsu=').partition(';')[0])};{rest}"
        wanted = ua.NodeId.from_string(text)
        while len(await server.get_namespace_array()) <= wanted.NamespaceIndex:
            await server.register_namespace(f"urn:emulated:{len(await server.get_namespace_array())}")
        if wanted.to_string() in self.variables:
            return self.variables[wanted.to_string()].node
        name = ua.QualifiedName(str(wanted.Identifier), wanted.NamespaceIndex)
        return await server.nodes.objects.add_variable(wanted, name, 0.0)

    async def _at_path(self, tag: Tag) -> Node:
        """Return the variable at a tag's path; creates it, the objects above it and a child for each ``*``."""
        node = self._server.nodes.objects
        steps = tag.steps
        for depth, step in enumerate(steps):
            number = await self._number(step.prefix)
            names = f"any_{step.nth or 1}" if step.any else step.name
            below = {(await c.read_browse_name()).Name: c for c in await node.get_children()}
            if names in below:
                node = below[names]
            elif depth == len(steps) - 1:
                node = await node.add_variable(number, names, 0.0)
            else:
                node = await node.add_object(number, names)
        return node

    async def _number(self, prefix: str) -> int:
        if not prefix or prefix.isdecimal():
            return int(prefix or 1)
        return int(await self._server.get_namespace_index(self._map.namespaces[prefix]))


class _Internal(InternalServer):  # type: ignore[misc]
    """Copies the standard's nodes from one set for all servers of this process: creating them takes 2 s."""

    async def load_standard_address_space(self, shelf_file: Path | None = None) -> None:
        """See ``InternalServer``."""
        self.aspace._nodes = _Copies({}, await asyncio.to_thread(_standard))


@cache
def _standard() -> dict[ua.NodeId, NodeData]:
    from asyncua.server.standard_address_space import standard_address_space

    made = AddressSpace()
    standard_address_space.fill_address_space(NodeManagementService(made))
    return dict(made._nodes)


class _Copies(ChainMap[ua.NodeId, NodeData]):
    """The server's own nodes; those of the second map are copied on first use."""

    def __getitem__(self, key: ua.NodeId) -> NodeData:
        own, others = self.maps
        if key not in own:
            own[key] = copy.deepcopy(others[key])
        return own[key]
