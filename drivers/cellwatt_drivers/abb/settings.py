"""Settings of an ABB source."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field, SecretStr, model_validator

from cellwatt.driver import SourceSettings
from cellwatt.host import Host, in_url
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.abb import wire
from cellwatt_drivers.abb.rws import Page, RobotWare
from cellwatt_drivers.shared.choice import EachOnce, whole_part_of


class AbbSettings(SourceSettings):
    """An ABB arm: IRC5 with RobotWare 6 or OmniCore with RobotWare 7."""

    device_parts: ClassVar[tuple[str, ...]] = ("mechanical_unit",)

    host: Host
    """Address of the controller."""
    port: int | None = Field(None, ge=1, le=65535)
    """TCP port of Robot Web Services; default 80 (RobotWare 6) or 443 (RobotWare 7)."""
    robotware: RobotWare = 7
    """Generation of the controller: 6 for IRC5, 7 for OmniCore."""
    egm: EachOnce[wire.Group] = ("joints", "planned", "state")
    """Groups to read from the EGM stream; ``[]`` does not listen to it."""
    egm_port: int = Field(wire.PORT, ge=1, le=65535)
    """UDP port of this PC to which the controller sends; each robot of a PC needs its own port."""
    bind: Host = "0.0.0.0"
    """Address of this PC at which to listen."""
    rate: Annotated[Hertz, whole_part_of(1 / wire.CYCLE)] = 250.0
    """Packets per second, as set in the RAPID program with ``\\SampleRate``: 250 Hz divided by a whole number."""
    axes: int = Field(6, ge=1, le=6)
    """Joints of the robot."""
    linear: tuple[Annotated[int, Field(ge=1, le=6)], ...] = ()
    """Linear joints of the robot, ``[3]`` for a SCARA: their channels are in m and N."""
    external: tuple[wire.External, ...] = Field((), max_length=6)
    """External axes, in the controller's order; the seventh joint of a 7-axis arm is one."""
    web: EachOnce[Page] = ("state", "energy")
    """Groups to read from Robot Web Services; ``[]`` does not connect to it."""
    web_rate: Hertz = Field(2.0, le=10)
    """Polls of the pages, at most 10 Hz; must be above the rate of the controller's energy measurements."""
    user: str = "Default User"
    """User of Robot Web Services; preferably a user with read access only."""
    password: SecretStr = SecretStr("robotics")
    """Password of ``user``, best as ``${ABB_PASSWORD}``; default ``robotics``."""
    tls: bool | None = None
    """HTTPS; default: yes on RobotWare 7, no on RobotWare 6."""
    certificate: str | None = None
    """File with the certificate to trust; without it, the controller's certificate is not checked."""
    mechanical_unit: str = "ROB_1"
    """Mechanical unit whose joints' energy is read."""
    energy_unit: float = Field(1.0, gt=0, allow_inf_nan=False)
    """J per unit of the controller's energy values; the manual does not name the unit."""
    timeout: Seconds = Field(2.0, gt=0)
    """Silence after which the source is down, and longest wait for a page."""

    @model_validator(mode="after")
    def _fits(self) -> AbbSettings:
        if self.linear and max(self.linear) > self.axes:
            raise ValueError(f"'linear' names joint {max(self.linear)}, 'axes' says {self.axes}")
        if not self.egm and not self.web:
            raise ValueError("name something in 'egm' or in 'web'")
        return self

    @property
    def encrypted(self) -> bool:
        """True if the pages are read over HTTPS."""
        return self.robotware == 7 if self.tls is None else self.tls

    @property
    def web_port(self) -> int:
        """TCP port of the pages."""
        return self.port or {6: 80, 7: 443}[self.robotware]

    @property
    def url(self) -> str:
        """Scheme, host and port of the pages' URLs."""
        return f"{'https' if self.encrypted else 'http'}://{in_url(self.host)}:{self.web_port}"
