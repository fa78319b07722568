"""The types of OPC UA for Devices and for Robotics that a cell uses, and the arms of a cell as instances of them.

Names are those of OPC 10000-100 and OPC 40010-1 release 1.02; node ids of the types are from their published lists.
The types have no member declarations.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from asyncua import Node, Server, ua

from cellwatt.units import CEFACT, TABLE

DI: Final = "http://opcfoundation.org/UA/DI/"
ROBOTICS: Final = "http://opcfoundation.org/UA/Robotics/"
_DEVICE_SET: Final = 5001
_DI_TYPES: Final = (("TopologyElementType", 1001, ""), ("ComponentType", 15063, "TopologyElementType"))
_ROBOTICS_TYPES: Final = {
    "MotionDeviceSystemType": 1002,
    "ControllerType": 1003,
    "MotionDeviceType": 1004,
    "SafetyStateType": 1013,
    "MotorType": 1019,
    "AxisType": 16601,
    "PowerTrainType": 16794,
}
_ROTARY, _LINEAR = 1, 3  # of MotionProfileEnumeration
_ANALOG_UNIT: Final = 17497
"""Node id of AnalogUnitType in the standard."""
_JOINT: Final = re.compile(r"joint_(\d+)\.(\w+)")
_OF_AXIS: Final = {"position": "ActualPosition", "velocity": "ActualSpeed"}
_OF_MOTOR: Final = {"temperature": "MotorTemperature", "current": "ActualCurrent", "torque": "ActualTorque"}
_STANDARD: Final = ("ActualPosition", "ActualSpeed", "MotorTemperature")
_CEFACT: Final = "http://www.opcfoundation.org/UA/units/un/cefact"


@dataclass(frozen=True, slots=True)
class Spaces:
    """Namespace indices: devices, robotics, and the cell's own."""

    di: int
    robotics: int
    own: int


def unit_of(name: str) -> ua.EUInformation:
    """Return a unit as OPC UA represents it; a unit without a code has the id -1."""
    return ua.EUInformation(_CEFACT, CEFACT.get(name, -1), ua.LocalizedText(name), ua.LocalizedText(name))


async def add_node(
    server: Server, parent: Node, node_id: ua.NodeId, name: ua.QualifiedName, kind: ua.NodeId, attributes: Any
) -> Node:
    """Add a component below a node; the library's own method accepts only its own types."""
    made = ua.AddNodesItem()
    made.RequestedNewNodeId, made.BrowseName, made.ParentNodeId = node_id, name, parent.nodeid
    made.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HasComponent)
    is_variable = isinstance(attributes, ua.VariableAttributes)
    made.NodeClass = ua.NodeClass.Variable if is_variable else ua.NodeClass.Object
    made.TypeDefinition, made.NodeAttributes = kind, attributes
    attributes.DisplayName = ua.LocalizedText(name.Name)
    (result,) = await server.iserver.isession.add_nodes([made])
    result.StatusCode.check()
    return server.get_node(node_id)


async def add_types(server: Server, spaces: Spaces) -> Node:
    """Add the types; return the device set."""
    base = server.get_node(ua.NodeId(ua.ObjectIds.BaseObjectType))
    known = {"": base}
    for name, number, above in _DI_TYPES:
        known[name] = await known[above].add_object_type(ua.NodeId(number, spaces.di), f"{spaces.di}:{name}")
    for name, number in _ROBOTICS_TYPES.items():
        await known["ComponentType"].add_object_type(ua.NodeId(number, spaces.robotics), f"{spaces.robotics}:{name}")
    return await server.nodes.objects.add_object(ua.NodeId(_DEVICE_SET, spaces.di), f"{spaces.di}:DeviceSet")


def joints(names: Sequence[str]) -> dict[str, dict[int, dict[str, str]]]:
    """Return the channels of joints by source, joint and quantity."""
    found: dict[str, dict[int, dict[str, str]]] = {}
    for name in names:
        source, _, short = name.partition(".")
        if (match := _JOINT.fullmatch(short)) and match[2] in {**_OF_AXIS, **_OF_MOTOR}:
            found.setdefault(source, {}).setdefault(int(match[1]), {})[match[2]] = name
    return found


class Arms:
    """A motion device system with a motion device for each source that has joints."""

    def __init__(self, server: Server, spaces: Spaces, devices: Node, cell: str) -> None:
        self._server = server
        self._spaces = spaces
        self._devices = devices
        self._cell = cell

    async def build(self, units: Mapping[str, str]) -> dict[str, Node]:
        """Add the nodes of new channels with these units to the system; return the variables by channel."""
        found: dict[str, Node] = {}
        if not (arms := joints(list(units))):
            return found
        system = await self._object(self._devices, "System", self._cell, "MotionDeviceSystemType")
        folders = {name: await self._folder(system, name) for name in ("MotionDevices", "Controllers", "SafetyStates")}
        for source, by_joint in arms.items():
            device = await self._object(folders["MotionDevices"], source, source, "MotionDeviceType")
            await self._identity(device, source)
            await self._property(device, self._spaces.robotics, "MotionDeviceCategory", 0)
            await self._parameters(device)
            axes, trains = await self._folder(device, "Axes"), await self._folder(device, "PowerTrains")
            for joint, channels in sorted(by_joint.items()):
                axis = await self._object(axes, f"{source}.Axis_{joint}", f"Axis_{joint}", "AxisType")
                linear = units.get(channels.get("position", "")) in TABLE["length"]
                await self._property(axis, self._spaces.robotics, "MotionProfile", _LINEAR if linear else _ROTARY)
                name = f"PowerTrain_{joint}"
                train = await self._object(trains, f"{source}.{name}", name, "PowerTrainType")
                motor = await self._object(train, f"{source}.Motor_{joint}", f"Motor_{joint}", "MotorType")
                await self._identity(motor, source)
                for parent, names in ((axis, _OF_AXIS), (motor, _OF_MOTOR)):
                    parameters = await self._parameters(parent)
                    for quantity in (each for each in names if each in channels):
                        channel = channels[quantity]
                        found[channel] = await self._variable(parameters, channel, names[quantity], units[channel])
        return found

    async def _variable(self, parent: Node, channel: str, name: str, unit: str) -> Node:
        """Add a numeric variable with its unit below a node, without a value yet."""
        attributes = ua.VariableAttributes()
        attributes.DataType = ua.NodeId(ua.ObjectIds.Double)
        attributes.ValueRank = ua.ValueRank.Scalar
        attributes.AccessLevel = attributes.UserAccessLevel = ua.AccessLevel.CurrentRead.mask
        attributes.Value = ua.Variant(0.0, ua.VariantType.Double)
        browsed = ua.QualifiedName(name, self._spaces.robotics if name in _STANDARD else self._spaces.own)
        node_id = ua.NodeId(f"robotics:{channel}", self._spaces.own)
        node = await add_node(self._server, parent, node_id, browsed, ua.NodeId(_ANALOG_UNIT), attributes)
        await node.add_property(0, "EngineeringUnits", unit_of(unit))
        return node

    async def _object(self, parent: Node, identifier: str, name: str, type_name: str) -> Node:
        kind = ua.NodeId(_ROBOTICS_TYPES[type_name], self._spaces.robotics)
        return await self._added(parent, f"robotics:{identifier}", ua.QualifiedName(name, self._spaces.own), kind)

    async def _folder(self, parent: Node, name: str) -> Node:
        return await self._child(parent, name, self._spaces.robotics, ua.ObjectIds.FolderType)

    async def _parameters(self, parent: Node) -> Node:
        return await self._child(parent, "ParameterSet", self._spaces.di, ua.ObjectIds.BaseObjectType)

    async def _child(self, parent: Node, name: str, namespace: int, kind: int) -> Node:
        identifier = f"{parent.nodeid.Identifier}/{name}"
        return await self._added(parent, identifier, ua.QualifiedName(name, namespace), ua.NodeId(kind))

    async def _added(self, parent: Node, identifier: str, name: ua.QualifiedName, kind: ua.NodeId) -> Node:
        """Return an object of the arms; add it if it is new."""
        node_id = ua.NodeId(identifier, self._spaces.own)
        if node_id in self._server.iserver.aspace:
            return self._server.get_node(node_id)
        return await parent.add_object(node_id, name, kind, False)

    async def _identity(self, node: Node, source: str) -> None:
        """Add the properties that the standard requires of each device; the cell knows only the source's name."""
        for name, value in (("Manufacturer", ua.LocalizedText("")), ("Model", ua.LocalizedText(source))):
            await self._property(node, self._spaces.di, name, value)
        for name in ("ProductCode", "SerialNumber"):
            await self._property(node, self._spaces.di, name, "")

    async def _property(self, node: Node, namespace: int, name: str, value: Any) -> None:
        node_id = ua.NodeId(f"{node.nodeid.Identifier}/{name}", self._spaces.own)
        if node_id not in self._server.iserver.aspace:
            await node.add_property(node_id, ua.QualifiedName(name, namespace), value)
