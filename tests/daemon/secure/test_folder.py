from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from cellwatt import ConfigError
from cellwatt.commands.secure import command
from cellwatt.door import certificates
from cellwatt.door.certificates import MEMBER_DAYS
from cellwatt.secure.folder import Folder, Member
from tests.calling import called


def secure(folder: Path, *arguments: str) -> str:
    return called(command, *arguments, "--in", folder)


@pytest.fixture
def open_umask() -> Iterator[None]:
    """A PC on which new files are everybody's."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    made = Folder.create(tmp_path / "secure", "plant-1")
    made.add(Member("plant-router", "router", ("plant-router", "192.0.2.9", "2001:db8::9")))
    made.add(Member("weld-3", "cell"))
    made.add(Member("anna", "viewer", (), ("weld-3",)))
    return made


@pytest.mark.usefixtures("open_umask")
def test_private_keys_are_their_owners_alone_and_never_shown(tmp_path: Path) -> None:
    at = tmp_path / "secure"
    said = called(command, "init", at, "--site", "plant-1")
    for line in (["cell", "weld-3", "--host", "192.0.2.1"], ["viewer", "anna"], ["renew", "anna"], ["list"]):
        said += secure(at, *line)
    said += secure(at, "remove", "anna")
    private = [p for p in at.rglob("*") if p.is_file() and b"PRIVATE KEY" in p.read_bytes()]
    assert {p.name for p in private} == {"ca.key", "key.pem", "sign.key"}
    for path in private:
        assert path.stat().st_mode & 0o777 == 0o600, path
        assert path.parent.stat().st_mode & 0o077 == 0, path
        assert not [line for line in path.read_text().splitlines() if line in said]
    assert not list(at.rglob("*.part"))


def test_certificates_are_what_openssl_expects(folder: Folder) -> None:
    for name, purposes in (("plant-router", ("sslserver", "sslclient")), ("anna", ("sslclient",))):
        for purpose in ("sslserver", "sslclient"):
            checked = subprocess.run(
                ["openssl", "verify", "-x509_strict", "-purpose", purpose, "-CAfile", "ca.pem", "cert.pem"],
                cwd=folder.path / name,
                capture_output=True,
                check=False,
            )
            assert (checked.returncode == 0) == (purpose in purposes), (name, purpose, checked.stderr)


def test_a_folder_is_opened_as_it_was_made(folder: Folder) -> None:
    again = Folder.open(folder.path)
    assert (again.site, again.members) == (folder.site, folder.members)
    assert again.write() == []


@pytest.mark.parametrize(
    ("member", "text"),
    [
        (Member("weld-3", "viewer"), "there is a member 'weld-3' already"),
        (Member("private", "viewer"), "cannot name a viewer"),
        (Member("../weld", "cell"), "cannot name a cell"),
        (Member("x" * 65, "cell"), "at most 64 characters"),
        (Member("bert", "viewer", (), ("weld-9",)), "no cell weld-9 here; add it first"),
        (Member("other", "router", ("h",)), "plant-router is the router of this site already"),
    ],
)
def test_mistakes_are_named(folder: Folder, member: Member, text: str) -> None:
    before = dict(folder.members)
    with pytest.raises(ConfigError, match=text):
        folder.add(member)
    assert folder.members == before


def test_a_cell_without_router_needs_a_host(tmp_path: Path) -> None:
    folder = Folder.create(tmp_path, "plant-1")
    with pytest.raises(ConfigError, match="name the cell's address with --host"):
        folder.add(Member("weld-3", "cell"))
    with pytest.raises(ConfigError, match="'wéld' is neither a host name nor an address"):
        folder.add(Member("weld-3", "cell", ("wéld",)))


def test_an_authority_is_never_overwritten(folder: Folder) -> None:
    key = (folder.path / "private" / "ca.key").read_bytes()
    with pytest.raises(ConfigError, match="already has an authority, which is not changed"):
        Folder.create(folder.path, "plant-1")
    assert (folder.path / "private" / "ca.key").read_bytes() == key


def test_a_wrong_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"access\.yaml: No such file or directory; begin with: cellwatt secure init"):
        Folder.open(tmp_path)
    (tmp_path / "access.yaml").write_text("members: [1, 2]\n")
    with pytest.raises(ConfigError, match="is not what cellwatt secure wrote"):
        Folder.open(tmp_path)


def test_renew_takes_what_ends_soon(folder: Folder) -> None:
    before = folder.end_of("anna")
    assert folder.renew([], timedelta(days=60)) == []
    assert folder.renew([], timedelta(days=MEMBER_DAYS + 1)) == ["plant-router", "weld-3", "anna"]
    assert folder.end_of("anna") >= before
    with pytest.raises(ConfigError, match="there is no member dora"):
        folder.renew(["dora"], timedelta())


def test_no_certificate_outlives_its_authority(folder: Folder) -> None:
    private = folder.path / "private"
    short = certificates.new_authority("plant-1", folder.end_of("anna") - timedelta(days=300), 10)
    (private / "ca.pem").write_bytes(short.certificate)
    (private / "ca.key").write_bytes(short.key)
    folder.renew(["anna"], timedelta())
    assert folder.end_of("anna") == folder.authority_ends()
    assert folder.authority_due()


def test_who_must_get_a_new_folder_is_told(folder: Folder) -> None:
    assert folder.add(Member("andon", "viewer")) == ["plant-router", "andon"]
    assert folder.add(Member("weld-4", "cell")) == ["plant-router", "andon", "weld-4"]  # andon sees all: its key too
    with pytest.raises(ConfigError, match="anna may see only weld-3: remove it first"):
        folder.remove("weld-3")
    assert folder.remove("anna") == ["plant-router"]


@pytest.mark.parametrize(("host", "listens"), [("2001:db8::9", "tls/[::]:7447"), ("r", "tls/0.0.0.0:7447")])
def test_a_router_listens_at_addresses_of_the_kind_that_it_is_known_by(tmp_path: Path, host: str, listens: str) -> None:
    Folder.create(tmp_path / "secure", "plant-1").add(Member("r", "router", ("192.0.2.9", host)))
    assert json.loads((tmp_path / "secure/r/zenohd.json5").read_text())["listen"] == {"endpoints": [listens]}
