"""The folder of a site's authority: the members, and a folder of files for each.

    access.yaml                      members and rights; written by the commands, readable by people
    private/ca.pem, ca.key           the authority that signs
    NAME/ca.pem, cert.pem, key.pem   for every member: the authority to trust, its certificate, its private key
    CELL/sign.key, sign.pub          a cell's key for signatures; viewers have sign.pub as CELL.pub
    NAME/zenoh.yaml                  settings of a cell or viewer; a router has zenohd.json5

Private keys are readable only by their owner from the moment they are made, and never shown.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import yaml

from cellwatt.door.certificates import MEMBER_DAYS, Pair, issue, new_authority, read
from cellwatt.door.signing import new_key
from cellwatt.errors import CellwattError, ConfigError, why
from cellwatt.files import replace_bytes
from cellwatt.secure import access
from cellwatt.secure.access import Member

PORT: Final = 7447
_REGISTER: Final = "access.yaml"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
"""A name is a certificate's common name (at most 64 characters), a chunk of a Zenoh key, and a folder."""
_KEEP_OPEN: Final = {"transport/link/tls/close_link_on_expiration": True}
"""Zenoh closes a link when the peer's certificate expires, not only at the next connection."""


@dataclass(slots=True)
class Folder:
    """An opened folder. Methods that write raise ``CellwattError`` if writing fails."""

    path: Path
    site: str
    members: dict[str, Member] = field(default_factory=dict)

    @classmethod
    def create(cls, path: Path, site: str) -> Folder:
        """Make the folder and its authority. Raises ``ConfigError`` if it exists or the site's name is invalid."""
        _check_name(site, "site")
        if os.access(path / _REGISTER, os.F_OK) or os.access(path / "private", os.F_OK):
            raise ConfigError(f"{path} already has an authority, which is not changed")
        folder = cls(path, site)
        pair = new_authority(site, datetime.now(UTC))
        _write(path / "private" / "ca.key", pair.key, 0o600)
        _write(path / "private" / "ca.pem", pair.certificate, 0o644)
        folder.write()
        return folder

    @classmethod
    def open(cls, path: Path) -> Folder:
        """Open the folder. Raises ``ConfigError`` if it has no authority."""
        try:
            plain = yaml.safe_load((path / _REGISTER).read_text())
            members = [
                Member(name, m["role"], tuple(m.get("hosts", ())), tuple(m.get("cells", ())), bool(m.get("asks", True)))
                for name, m in plain["members"].items()
            ]
            return cls(path, str(plain["site"]), {m.name: m for m in members})
        except OSError as error:
            raise ConfigError(
                f"{path / _REGISTER}: {why(error)}; begin with: cellwatt secure init DIR --site NAME, "
                "or name the folder with --in"
            ) from None
        except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
            raise ConfigError(f"{path / _REGISTER} is not what cellwatt secure wrote: {error}") from None

    def add(self, member: Member) -> list[str]:
        """Make a member's certificate; return the members whose folders changed. Raises ``ConfigError``."""
        _check_name(member.name, member.role)
        if member.name in self.members or (self.path / member.name).exists():
            raise ConfigError(f"there is a member {member.name!r} already; remove it first, or choose another name")
        if unknown := [c for c in member.cells if c not in [cell.name for cell in self.cells]]:
            raise ConfigError(f"no cell {', '.join(unknown)} here; add it first: cellwatt secure cell NAME")
        if member.role == "router" and self.router is not None:
            raise ConfigError(f"{self.router.name} is the router of this site already; one is written for")
        if member.role == "cell" and self.router is None and not member.hosts:
            raise ConfigError("no router yet: name the cell's address with --host, or add the router first")
        self._issue(member)
        if member.role == "cell":
            key, public = new_key()
            _write(self.path / member.name / "sign.key", key, 0o600)
            _write(self.path / member.name / "sign.pub", public, 0o644)
        self.members[member.name] = member
        return self.write()

    def remove(self, name: str) -> list[str]:
        """Remove a member from the rules, not its folder; return the members whose folders changed."""
        if name not in self.members:
            raise ConfigError(f"there is no member {name!r}; there are: {', '.join(self.members) or 'none'}")
        del self.members[name]
        for viewer in [m for m in self.members.values() if name in m.cells]:
            if viewer.cells == (name,):
                raise ConfigError(f"{viewer.name} may see only {name}: remove it first")
            self.members[viewer.name] = replace(viewer, cells=tuple(c for c in viewer.cells if c != name))
        return self.write()

    def renew(self, names: Sequence[str], within: timedelta) -> list[str]:
        """Renew the certificates of these members, or all that expire soon; old ones stay valid until they expire."""
        if unknown := [n for n in names if n not in self.members]:
            raise ConfigError(f"there is no member {', '.join(unknown)}")
        due = names or [n for n in self.members if self.end_of(n) < datetime.now(UTC) + within]
        for name in due:
            self._issue(self.members[name])
        return list(due)

    def write(self) -> list[str]:
        """Write the register and the members' files; return the members whose folders changed."""
        members = {m.name: {k: v for k, v in _plain(m).items() if k != "name"} for m in self.members.values()}
        text = f"# Written by cellwatt secure.\n{_yaml({'site': self.site, 'members': members})}"
        _write(self.path / _REGISTER, text.encode(), 0o644)
        changed = []
        for member in self.members.values():
            files = dict(self._files(member))
            at = self.path / member.name
            if any(not (at / n).exists() or (at / n).read_bytes() != data for n, data in files.items()):
                changed.append(member.name)
            for name, data in files.items():
                _write(at / name, data, 0o644)
        return changed

    @property
    def router(self) -> Member | None:
        """The router between cells and viewers, if there is one."""
        return next((m for m in self.members.values() if m.role == "router"), None)

    @property
    def cells(self) -> list[Member]:
        """All cells."""
        return [m for m in self.members.values() if m.role == "cell"]

    def end_of(self, name: str) -> datetime:
        """Expiry of a member's certificate."""
        return _end(self.path / name / "cert.pem")

    def authority_ends(self) -> datetime:
        """Expiry of the signing authority."""
        return _end(self.path / "private" / "ca.pem")

    def authority_due(self) -> bool:
        """True if the authority should be renewed, because its expiry would soon shorten new certificates."""
        return self.authority_ends() < datetime.now(UTC) + timedelta(days=2 * MEMBER_DAYS)

    def _issue(self, member: Member) -> None:
        private = self.path / "private"
        authority = Pair(_read(private / "ca.pem"), _read(private / "ca.key"))
        # A cell behind a router does not listen, and its certificate does not allow it to.
        hosts = () if member.role == "cell" and self.router is not None else member.hosts
        pair = issue(authority, member.name, hosts, datetime.now(UTC))
        _write(self.path / member.name / "key.pem", pair.key, 0o600)
        _write(self.path / member.name / "cert.pem", pair.certificate, 0o644)

    def _files(self, member: Member) -> Iterator[tuple[str, bytes]]:
        """A member's files other than its certificate and keys."""
        yield "ca.pem", _read(self.path / "private" / "ca.pem")
        if member.role == "router":
            yield "zenohd.json5", (json.dumps(self._router_settings(member), indent=2) + "\n").encode()
            return
        yield "zenoh.yaml", _yaml({"zenoh": self._settings(member)}).encode()
        if member.role == "viewer":
            for cell in self._seen_by(member):
                yield f"{cell.name}.pub", _read(self.path / cell.name / "sign.pub")

    def _settings(self, member: Member) -> dict[str, Any]:
        """A cell's or viewer's ``LinkSettings``."""
        found: dict[str, Any] = {}
        options: dict[str, Any] = dict(_KEEP_OPEN)
        if self.router is not None:
            found = {"mode": "client", "connect": [_endpoint(self.router.hosts[0])]}
        elif member.role == "viewer":
            found = {"mode": "client", "connect": [_endpoint(c.hosts[0]) for c in self._seen_by(member)]}
        else:
            found = {"listen": [_anywhere(member)]}
            options["access_control"] = access.for_cell(self.site, member, self._viewers())
        files = {"root_ca": "ca.pem", "certificate": "cert.pem", "key": "key.pem"}
        found["tls"] = {option: f"{member.name}/{file}" for option, file in files.items()}
        if member.role == "cell":
            found["sign"] = f"{member.name}/sign.key"
        return {**found, "options": options}

    def _router_settings(self, router: Member) -> dict[str, Any]:
        """A router's configuration for ``zenohd --config``."""
        at = {kind: f"{router.name}/{file}" for kind, file in (("certificate", "cert.pem"), ("private_key", "key.pem"))}
        tls = {"root_ca_certificate": f"{router.name}/ca.pem", "enable_mtls": True, "close_link_on_expiration": True}
        return {
            "mode": "router",
            "listen": {"endpoints": [_anywhere(router)]},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "transport": {"link": {"tls": {**tls, **{f"listen_{kind}": file for kind, file in at.items()}}}},
            "access_control": access.for_router(self.site, self.cells, self._viewers()),
        }

    def _viewers(self) -> list[Member]:
        return [m for m in self.members.values() if m.role == "viewer"]

    def _seen_by(self, viewer: Member) -> list[Member]:
        return [c for c in self.cells if not viewer.cells or c.name in viewer.cells]


def _plain(member: Member) -> dict[str, Any]:
    plain = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(member).items() if v != ()}
    return plain if member.role == "viewer" else {k: v for k, v in plain.items() if k != "asks"}


def _endpoint(host: str) -> str:
    return f"tls/[{host}]:{PORT}" if ":" in host else f"tls/{host}:{PORT}"


def _anywhere(member: Member) -> str:
    """The endpoint at which a member listens: all IPv4 addresses, or all addresses if one of its hosts is IPv6."""
    return _endpoint("::" if any(":" in host for host in member.hosts) else "0.0.0.0")


def _check_name(name: str, what: str) -> None:
    if not _NAME.fullmatch(name) or name == "private":
        raise ConfigError(f"{name!r} cannot name a {what}: letters, digits, '_', '-', '.', at most 64 characters")


def _end(path: Path) -> datetime:
    return read(_read(path))[0].not_valid_after_utc


def _yaml(plain: Any) -> str:
    return yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise CellwattError(f"{path} cannot be read: {why(error)}") from None


def _write(path: Path, data: bytes, mode: int) -> None:
    """Replace a file atomically; only the owner can ever read a private key."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        path.with_name(f"{path.name}.part").unlink(missing_ok=True)  # the new file must not inherit its permissions
        replace_bytes(path, data, mode)
    except OSError as error:
        raise CellwattError(f"{path} cannot be written: {why(error)}") from None
