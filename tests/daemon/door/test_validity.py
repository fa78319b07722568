from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from cellwatt.door import validity
from cellwatt.door.certificates import Pair, issue, new_authority
from cellwatt.outlets.zenoh.link import LinkSettings, TlsSettings

NOW = datetime.now(UTC)


def write(folder: Path, authority: Pair, own: Pair) -> LinkSettings:
    for name, data in (("ca.pem", authority.certificate), ("cert.pem", own.certificate), ("key.pem", own.key)):
        (folder / name).write_bytes(data)
        (folder / name).chmod(0o600)
    files = {"root_ca": folder / "ca.pem", "certificate": folder / "cert.pem", "key": folder / "key.pem"}
    return LinkSettings(mode="client", connect=("tls/plant-router:7447",), tls=TlsSettings(**files))


def warnings(settings: LinkSettings) -> tuple[str, ...]:
    return validity.warnings(settings.tls.certificate, settings.tls.key, settings.tls.root_ca)


@pytest.mark.parametrize(
    ("begun", "text"),
    [
        (timedelta(), None),
        (timedelta(days=360), None),
        (timedelta(days=398 - 29, hours=-1), r"ends on \d{4}-\d\d-\d\d, in 29 days: run cellwatt secure renew"),
        (timedelta(days=398, hours=-1), "in 0 days"),
        (timedelta(days=399), "ended on .*: no peer accepts it; run cellwatt secure renew"),
        (-timedelta(days=3), "begins only on .*: is this PC's clock right"),
    ],
)
def test_the_time_of_a_certificate(tmp_path: Path, begun: timedelta, text: str | None) -> None:
    authority = new_authority("plant-1", NOW - timedelta(days=500))
    found = warnings(write(tmp_path, authority, issue(authority, "weld-3", (), NOW - begun)))
    if text is None:
        assert found == ()
    else:
        (told,) = found
        assert told.startswith(f"certificate: {tmp_path}/cert.pem ")
        assert re.search(text, told), told


def test_an_authority_that_ends(tmp_path: Path) -> None:
    old = new_authority("plant-1", NOW - timedelta(days=3640))
    new = new_authority("plant-1", NOW)
    own = issue(new, "weld-3", (), NOW)
    (told,) = warnings(write(tmp_path, old, own))
    assert told.startswith("root_ca: ")
    assert "in 9 days" in told or "in 10 days" in told
    both = Pair(old.certificate + new.certificate, b"")
    assert warnings(write(tmp_path, both, own)) == ()


def test_a_key_that_belongs_to_another_certificate(tmp_path: Path) -> None:
    authority = new_authority("plant-1", NOW)
    one, other = (issue(authority, name, (), NOW) for name in ("one", "other"))
    (told,) = warnings(write(tmp_path, authority, Pair(one.certificate, other.key)))
    assert told == f"key: {tmp_path}/key.pem is not the key of {tmp_path}/cert.pem"


def test_what_is_no_certificate_and_no_key(tmp_path: Path) -> None:
    authority = new_authority("plant-1", NOW)
    found = warnings(write(tmp_path, Pair(b"none", b""), Pair(issue(authority, "a", (), NOW).certificate, b"none")))
    assert [text.split(":")[0] for text in found] == ["key", "root_ca"]
    (only, _) = warnings(write(tmp_path, Pair(b"none", b""), Pair(b"none", b"none")))
    assert only == f"certificate: {tmp_path}/cert.pem is not a certificate"
