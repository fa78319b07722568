"""The page as an outlet: its settings and access rules, and the outlet that feeds the serving process."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar, Final, Literal

from pydantic import Field, PositiveInt, SecretStr, field_validator

from cellwatt.door.settings import Listening
from cellwatt.host import Host
from cellwatt.outlets.apart.outlet import ApartOutlet
from cellwatt.outlets.page.sessions import parse
from cellwatt.quantity import Bytes
from cellwatt.results import Prediction
from cellwatt.section import Section

LOCAL: Final = "127.0.0.1:8480"
_LONGEST_NAME: Final = 100


class UserSettings(Section):
    """One person, or a group that shares a login."""

    password: SecretStr
    """Hash of the password, from ``cellwatt view --hash-password``; never the password itself."""
    may: Literal["look", "act"] = "look"
    """``look``: read-only. ``act``: may also acknowledge and shelve alarms."""

    @field_validator("password")
    @classmethod
    def _hashed(cls, password: SecretStr) -> SecretStr:
        parse(password.get_secret_value())
        return password


class PageSettings(Listening):
    """Shows the cell in a browser."""

    listen: str = LOCAL
    """Address and port at which the page is served; an address other than loopback needs a certificate and users."""
    names: tuple[Host, ...] = ()
    """Further host names of the page, beside the names in the certificate, the name of this PC, and IP addresses.

    With names but without users the page is read-only, as a proxy on this PC may give strangers access.
    """
    users: Mapping[str, UserSettings] = Field(default_factory=dict)
    """Users who may log in, by name; without users the page needs no login."""
    arms: Mapping[str, Path] = Field(default_factory=dict)
    """Shape of the arm of a source: its URDF, its ``robot.yaml``, or the folder that contains one."""
    reports: Path | None = None
    """Folder of reports to show beside the evidence of alarms, e.g. of ``cellwatt explain``."""
    levels: Bytes = 4e9
    """Disk space for level files, which make curves of long spans fast; they need about 11 % of the recordings' size.

    Level files of the oldest recordings are removed first; their long spans are then read slowly, from the recordings.
    """
    browsers: PositiveInt = 64
    """Largest number of browsers that follow the cell at the same time."""
    open: bool = False
    """Serve the network without certificate or users: anybody on the network can then see the cell."""

    @field_validator("users")
    @classmethod
    def _called(cls, users: Mapping[str, UserSettings]) -> Mapping[str, UserSettings]:
        for name in users:
            if not 0 < len(name) <= _LONGEST_NAME or not name.isprintable() or name != name.strip():
                raise ValueError(f"a user's name has 1 to {_LONGEST_NAME} printable characters, found {name!r:.120}")
        return users

    @property
    def asks(self) -> bool:
        """See ``Listening.asks``."""
        return bool(self.users)

    def warnings(self) -> tuple[str, ...]:
        """See ``Listening.warnings``; also warns of a local page that a proxy may serve to the network."""
        proxied = "names: anybody who reaches the page through a proxy on this PC sees the cell without a login"
        return (*super().warnings(), *([proxied] if self.local and self.names and not self.users else []))

    def may_act(self, name: str | None) -> bool:
        """True if a user may act; ``None`` is a visitor without login."""
        if not self.users:
            return self.local and not self.names
        return name is not None and name in self.users and self.users[name].may == "act"


if find_spec("aiohttp") is None:  # only the serving process imports it, but report at once that it is missing
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")


class PageOutlet(ApartOutlet[PageSettings]):
    """Shows a cell in a browser: frames, results, events and health; receives orders of users.

    A separate process serves the page, so that browsers cannot delay the daemon.
    """

    Settings: ClassVar[type[PageSettings]] = PageSettings
    title = "The cell in a browser: live, its past, its alarms to acknowledge"
    module = "cellwatt.outlets.page.serving"
    what = "the process that serves the page"
    memory = 2 << 30
    forgets = Prediction
