"""The OPC UA server of a cell: access, and its nodes."""

from __future__ import annotations

import contextlib
import logging
import math
import socket
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from asyncua import Node, ua
from cryptography import x509

from cellwatt.channel import Quality
from cellwatt.errors import OutletError
from cellwatt.frames import Frames
from cellwatt.host import in_url
from cellwatt.outlets.apart.daemon import Daemon, Shown, main
from cellwatt.outlets.opc_ua.access import Users, trust_only
from cellwatt.outlets.opc_ua.arrays import bound_arrays
from cellwatt.outlets.opc_ua.bounds import BoundedServer
from cellwatt.outlets.opc_ua.conditions import Conditions, Order
from cellwatt.outlets.opc_ua.outlet import OpcUaOutletSettings
from cellwatt.outlets.selection import Picker
from cellwatt.outlets.zenoh.messages import encode_json
from cellwatt.results import Alarm, Energy, Event, Result
from cellwatt.units import CEFACT
from cellwatt.version import __version__

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_STATUS: Final = {
    Quality.GOOD: ua.StatusCodes.Good,
    Quality.INTERPOLATED: ua.StatusCodes.UncertainSensorNotAccurate,
    Quality.LATE: ua.StatusCodes.Good,
    Quality.CLIPPED: ua.StatusCodes.UncertainEngineeringUnitsExceeded,
    Quality.MISSING: ua.StatusCodes.BadNoCommunication,
}
"""Status of a value by its quality."""
_CEFACT: Final = "http://www.opcfoundation.org/UA/units/un/cefact"


class CellServer:
    """A server for one cell."""

    def __init__(self, settings: OpcUaOutletSettings, site: str, cell: str, order: Order) -> None:
        self._settings, self._site, self._cell_name = settings, site, cell
        self._order = order
        users = {name: password.get_secret_value() for name, password in settings.users.items()}
        self._server = BoundedServer(Users(users))
        self._picker: Picker | None = None
        self._channels: dict[str, Node] = {}
        self._tasks: dict[str, Node] = {}

    async def open(self) -> str:
        """Make the nodes common to all cells, and listen; return the URL. Raises ``OSError`` or ``ValueError``."""
        s, server = self._settings, self._server
        host, port = s.host, _free(s.host, s.port)
        server.iserver.bind_condition_methods = True  # clients that connect later request the active alarms
        await server.init()
        url = f"opc.tcp://{in_url(host)}:{port}{s.path}"
        server.set_endpoint(url)
        server.socket_address = (host, port)
        server.set_server_name(f"cellwatt {self._site}/{self._cell_name}")
        await server.set_application_uri(await self._secure())
        await server.set_build_info("urn:cellwatt", "cellwatt", "cellwatt", __version__, "", datetime.now(UTC))
        server.set_identity_tokens([ua.UserNameIdentityToken if s.users else ua.AnonymousIdentityToken])
        self._space = await server.register_namespace(f"urn:cellwatt:{self._site}:{self._cell_name}")
        self._cell = await server.nodes.objects.add_object(self._id("cell"), self._name(self._cell_name))
        self._values = await self._folder("Values")
        self._energies = await self._folder("Energy")
        self._health = await self._cell.add_variable(self._id("Health"), self._name("Health"), "{}")
        self._conditions = Conditions(server, self._space, self._cell, self._order)
        self._conditions.listen()
        await server.start()
        return url

    @property
    def counts(self) -> Mapping[str, int]:
        """Counts of refused connections and logins."""
        return self._server.counts

    async def close(self) -> None:
        """Disconnect all clients."""
        await self._server.stop()

    # data of the cell -----------------------------------------------------------------------------

    async def frames(self, frames: Frames) -> None:
        """Update the channels' values, at the rate of the settings."""
        if self._picker is None or self._picker.layout is not frames.layout:
            self._picker = Picker(self._settings, frames.layout)
            await self._lay_out(self._picker.units)
        for row in self._picker.rows(frames):
            for name, quality in row.quality.items():
                value = row.values.get(name, math.nan)
                known = math.isfinite(value)
                status = _STATUS[Quality(quality)] if known else ua.StatusCodes.BadNoCommunication
                variant = ua.Variant(value, ua.VariantType.Double) if known else ua.Variant(None)
                await self._set(self._channels[name], variant, status, row.time)

    async def item(self, item: Result | Event) -> None:
        """Update a condition from an alarm or an acknowledgement, or the energy of a task."""
        match item:
            case Alarm():
                await self._conditions.hear(item)
            case Energy():
                await self._energy(item)
            case Event():
                await self._conditions.note(item)

    async def _energy(self, energy: Energy) -> None:
        """Update the energy of a task, J."""
        name = f"{energy.source}.{energy.task}"
        if name not in self._tasks:
            self._tasks[name] = await self._quantity(self._energies, f"energy:{name}", name, "J")
        value = ua.Variant(float(energy.total), ua.VariantType.Double)
        await self._set(self._tasks[name], value, ua.StatusCodes.Good, energy.end)

    async def health(self, status: Mapping[str, Any]) -> None:
        """Update the cell's health, as JSON, and the conditions from its list of alarms."""
        text = encode_json(status).decode()
        await self._set(self._health, ua.Variant(text, ua.VariantType.String), ua.StatusCodes.Good, None)
        await self._conditions.agree(status)

    # inside ---------------------------------------------------------------------------------------

    async def _lay_out(self, units: Mapping[str, str]) -> None:
        """Add variables for new channels; set the values of existing variables to bad."""
        for name, node in self._channels.items():
            await self._set(node, ua.Variant(None), ua.StatusCodes.BadNoCommunication, None)
            if name in units:  # it may have another unit now
                await (await node.get_child("0:EngineeringUnits")).write_value(_unit(units[name]))
        for name in [each for each in units if each not in self._channels]:
            node = self._channels[name] = await self._quantity(self._values, name, name, units[name])
            await self._set(node, ua.Variant(None), ua.StatusCodes.BadWaitingForInitialData, None)

    async def _quantity(self, folder: Node, identifier: str, name: str, unit: str) -> Node:
        """Add a numeric variable with its unit to a folder."""
        node = await folder.add_variable(self._id(identifier), self._name(name), 0.0)
        await node.add_property(0, "EngineeringUnits", _unit(unit))
        return node

    async def _set(self, node: Node, value: ua.Variant, status: int, time: int | None) -> None:
        moment = datetime.now(UTC) if time is None else _EPOCH + timedelta(microseconds=time // 1000)
        stamped = ua.DataValue(value, ua.StatusCode(status), SourceTimestamp=moment, ServerTimestamp=datetime.now(UTC))
        await self._server.write_attribute_value(node.nodeid, stamped)

    async def _folder(self, name: str) -> Node:
        kind = ua.NodeId(ua.ObjectIds.FolderType)
        return await self._cell.add_object(self._id(name), self._name(name), kind)

    def _id(self, identifier: str) -> ua.NodeId:
        return ua.NodeId(identifier, self._space)

    def _name(self, text: str) -> ua.QualifiedName:
        return ua.QualifiedName(text, self._space)

    async def _secure(self) -> str:
        """Set policies and certificates; return the application's URI, which the certificate names."""
        s, server = self._settings, self._server
        uri = f"urn:cellwatt:{self._site}:{self._cell_name}:server"
        if s.certificate is None or s.key is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            return uri
        server.set_security_policy(
            [ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt, ua.SecurityPolicyType.Basic256Sha256_Sign]
        )
        await server.load_certificate(s.certificate, "pem")
        await server.load_private_key(s.key, format="pem")
        if s.trusted:
            await trust_only(server, s.trusted)
        with contextlib.suppress(x509.ExtensionNotFound):
            names = server.iserver.certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            uri = next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), uri)
        return uri


def _unit(name: str) -> ua.EUInformation:
    """Return a unit as OPC UA represents it; a unit without a code has the id -1."""
    return ua.EUInformation(_CEFACT, CEFACT.get(name, -1), ua.LocalizedText(name), ua.LocalizedText(name))


def _free(host: str, port: int) -> int:
    """Return the port, or a free one for 0. Raises ``OSError`` if it is in use: making the nodes takes seconds."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
        return int(probe.getsockname()[1])


async def serve(daemon: Daemon, hello: Mapping[str, Any]) -> None:
    """Serve the daemon's data until it disconnects. Raises ``OutletError`` if the server cannot be made or listen."""
    server = CellServer(hello["settings"], hello["site"], hello["cell"], daemon.order)
    try:
        url = await server.open()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutletError(f"{hello['settings'].listen}: the server cannot listen or be made: {reason}") from error
    try:
        await daemon.serve(url, lambda: server.counts, Shown(server.frames, server.item, server.health))
    finally:
        await server.close()


if __name__ == "__main__":
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    bound_arrays()
    main(serve, logging.WARNING)
