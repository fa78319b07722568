"""Settings of an OPC UA source, and the tags that they name."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field, FilePath, SecretStr, model_validator

from cellwatt.config import read_settings
from cellwatt.driver import SourceSettings
from cellwatt.host import Host, in_url
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.opc_ua.tag_map import ModelName, Prefix, Tag, TagMap, check_prefixes, packaged_map
from cellwatt_drivers.shared.choice import Chosen
from cellwatt_drivers.shared.maps import ChannelName

PORT = 4840
SecurityMode = Literal["none", "sign", "encrypt"]


class OpcUaSettings(SourceSettings):
    """A PLC or robot controller with an OPC UA server. A subscription reads it; nothing is written."""

    device_parts: ClassVar[tuple[str, ...]] = ("path",)

    host: Host
    """Address of the server."""
    port: int = Field(PORT, ge=1, le=65535)
    """TCP port."""
    path: str = ""
    """Path in the endpoint's URL, if the server requires one: ``/UA/Server``."""
    model: ModelName | None = None
    """A packaged map of tags: ``opc_40010`` for any robot with the types of OPC UA for Robotics."""
    map: FilePath | None = None
    """File with your own map instead of ``model``."""
    tags: dict[ChannelName, Tag] = Field(default_factory=dict)
    """Tags by channel, instead of a map or in addition to it."""
    namespaces: dict[Prefix, str] = Field(default_factory=dict)
    """Namespace URIs by the prefix used in ``tags``."""
    read: Chosen[str] | None = None
    """Channels to read; omitted: all."""
    rate: Hertz = Field(10.0, gt=0, le=1000)
    """Samples per second that the server is to take."""
    publish: Seconds = Field(0.1, gt=0)
    """Interval at which the server sends changed values."""
    queue: int | None = Field(None, ge=1, le=10_000)
    """Values of each tag that the server queues between messages; omitted: 2 s of values, at least 10."""
    every_sample: bool = False
    """Request unchanged values, too, by their time stamps; not every server supports this."""
    time: Literal["source", "server"] = "source"
    """Time stamps to use: the ``source``'s, or the ``server``'s if the source sends none."""
    security: SecurityMode = "none"
    """Policy Basic256Sha256 with messages that are signed (``sign``), or signed and encrypted (``encrypt``)."""
    certificate: FilePath | None = None
    """This PC's certificate (PEM or DER) with an application URI; the server must trust it."""
    key: FilePath | None = None
    """Private key of ``certificate``."""
    key_password: SecretStr | None = None
    """Password of ``key``."""
    server_certificate: FilePath | None = None
    """Certificate that the server must have; omitted: any certificate is accepted."""
    user: str | None = None
    """User to log in; omitted: none."""
    password: SecretStr = SecretStr("")
    """Its password, best as ``${OPC_UA_PASSWORD}``."""
    user_certificate: FilePath | None = None
    """Certificate (PEM or DER) of the user to log in, instead of ``user``; the server must know it."""
    user_key: FilePath | None = None
    """Private key of ``user_certificate``."""
    user_key_password: SecretStr | None = None
    """Password of ``user_key``."""
    unencrypted: bool = False
    """Send the password even if it is not encrypted."""
    timeout: Seconds = Field(4.0, gt=0)
    """Longest wait for an answer."""
    silence: Seconds = Field(5.0, gt=0)
    """Longest time without a message or keep-alive: after it the session is opened again."""

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
        """Values of each tag that the server is asked to queue."""
        return self.queue or max(10, math.ceil(2.0 * self.rate))

    @property
    def url(self) -> str:
        """The endpoint's URL."""
        return f"opc.tcp://{in_url(self.host)}:{self.port}{self.path}"

    @property
    def tag_map(self) -> TagMap:
        """Map of all tags: the packaged one or the file's, and those of ``tags``. Raises ``ConfigError``."""
        made = read_settings(self.map, TagMap) if self.map else packaged_map(self.model) if self.model else None
        if made is None:
            return TagMap(source="settings", namespaces=self.namespaces, values=self.tags)
        both = {"values": made.values | self.tags, "namespaces": made.namespaces | self.namespaces}
        return made.model_copy(update=both)
