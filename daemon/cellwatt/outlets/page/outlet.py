"""The page as an outlet: its settings, who may come in by them, and what the process that serves it is told."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import ClassVar, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveInt, SecretStr, field_validator

from cellwatt.door.settings import Listening
from cellwatt.host import check_host
from cellwatt.outlets.apart.outlet import ApartOutlet
from cellwatt.outlets.page.sessions import parse
from cellwatt.quantity import Bytes
from cellwatt.results import Prediction

LOCAL: Final = "127.0.0.1:8480"
_LONGEST_NAME: Final = 100


class UserSettings(BaseModel):
    """One person, or a group that shares a login."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, hide_input_in_errors=True)

    password: SecretStr
    """Hash of the password, as ``cellwatt view --hash-password`` prints it; never the password itself."""
    may: Literal["look", "act"] = "look"
    """``act`` may also acknowledge and shelve alarms."""

    @field_validator("password")
    @classmethod
    def _hashed(cls, password: SecretStr) -> SecretStr:
        parse(password.get_secret_value())
        return password


class PageSettings(Listening):
    """The cell in a browser."""

    listen: str = LOCAL
    """Address and port at which the page is served; beyond this PC only with a certificate and users."""
    names: tuple[str, ...] = ()
    """Host names by which browsers reach the page, beside those of the certificate, of this PC, and addresses.

    With names but without users nobody may act, as a proxy on this PC may bring strangers.
    """
    certificate: Path | None = None
    """Certificate (PEM) with which the page is served as https, with the authorities between, if there are any."""
    users: Mapping[str, UserSettings] = Field(default_factory=dict)
    """Who may log in, by name; where there are none, nobody is asked."""
    arms: Mapping[str, Path] = Field(default_factory=dict)
    """Shape of the arm of a source: its URDF, its ``robot.yaml``, or the folder that holds it."""
    reports: Path | None = None
    """Folder of reports to show beside the evidence of alarms, e.g. of ``cellwatt explain``."""
    levels: Bytes = 4e9
    """Disk space of what makes curves of long spans fast; beside the record it takes some 11 % of its size.

    Those of the oldest recordings go first: their long spans are then read slowly, from the recordings themselves.
    """
    browsers: PositiveInt = 64
    """Browsers that may follow the cell at the same time."""
    open: bool = False
    """Let the network in without certificate or users: anybody there can then see the cell."""

    @field_validator("names")
    @classmethod
    def _hosts(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(check_host(name) for name in names)

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
        """See ``Listening.warnings``; also a page of this PC that a proxy may bring to others."""
        proxied = "names: whoever reaches the page by them, through a proxy on this PC, sees the cell without a login"
        return (*super().warnings(), *([proxied] if self.local and self.names and not self.users else []))

    def may_act(self, name: str | None) -> bool:
        """True if a user, or ``None`` for whoever comes where there are no users, may change anything."""
        if not self.users:
            return self.local and not self.names
        return name is not None and name in self.users and self.users[name].may == "act"


if find_spec("aiohttp") is None:  # only the process that serves imports it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")


class PageOutlet(ApartOutlet[PageSettings]):
    """Shows a cell in a browser: frames, results, events and health; what comes back are orders of people.

    A process of its own serves, so that no browser holds up what the daemon does.
    """

    Settings: ClassVar[type[PageSettings]] = PageSettings
    title = "The cell in a browser: live, its past, its alarms to acknowledge"
    module = "cellwatt.outlets.page.serving"
    what = "the process that serves the page"
    memory = 2 << 30
    forgets = Prediction
