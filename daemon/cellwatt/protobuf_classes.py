"""Classes of Protocol Buffers messages, made from a table, in a pool of their own: another library's do not clash."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Final

from cellwatt.errors import ProtocolError

Table = Mapping[str, Mapping[str, tuple[int, str]]]
"""Fields by message: number and type. A type with a star repeats; of those with a dot one is there at most."""
_SCALARS: Final = {"double": 1, "float": 2, "uint64": 4, "enum": 5, "bool": 8, "string": 9, "uint32": 13}
"""Types by name; an enum travels as an int32 does."""
_MESSAGE: Final = 11


class Messages:
    """Messages of ``package`` (proto2), all of whose fields are optional; the library is loaded with the first."""

    def __init__(self, package: str, table: Table) -> None:
        self._package, self._table = package, table

    def parse(self, name: str, data: bytes, what: str) -> Any:
        """A message from its bytes. Raises ``ProtocolError`` where they are not ``what``."""
        from google.protobuf.message import DecodeError

        message = self.classes[name]()
        try:
            message.ParseFromString(data)
        except DecodeError as error:
            raise ProtocolError(f"{len(data)} bytes that are not {what}") from error
        return message

    @cached_property
    def classes(self) -> Mapping[str, Any]:
        """Message classes by name."""
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

        package = self._package
        file = descriptor_pb2.FileDescriptorProto(name=f"cellwatt/{package}.proto", package=package, syntax="proto2")
        for name, fields in self._table.items():
            message = file.message_type.add(name=name)
            for field, (number, kind) in fields.items():
                plain = kind.rstrip("*.")
                added = message.field.add(name=field, number=number, label=3 if kind.endswith("*") else 1)
                added.type = _SCALARS.get(plain, _MESSAGE)
                if plain not in _SCALARS:
                    added.type_name = f".{package}.{plain}"
                if kind.endswith("."):
                    if not message.oneof_decl:
                        message.oneof_decl.add(name="value")
                    added.oneof_index = 0
        pool = descriptor_pool.DescriptorPool()
        pool.Add(file)
        known = {name: pool.FindMessageTypeByName(f"{package}.{name}") for name in self._table}
        return {name: message_factory.GetMessageClass(found) for name, found in known.items()}
