"""Who may come in by the settings of the page, and that a password never stands in them."""

from __future__ import annotations

import json
from base64 import b64encode
from pathlib import Path

import pytest
from pydantic import ValidationError

from cellwatt.outlet import revealed
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.sessions import hash_of, parse
from tests.daemon.outlets.page.cell import HASH, PASSWORD, USERS


@pytest.mark.parametrize("listen", ["127.0.0.1:8480", "localhost:80", "[::1]:8480"])
def test_this_pc_alone_needs_nothing(listen: str) -> None:
    settings = PageSettings(listen=listen)
    assert settings.warnings() == ()
    assert settings.local
    assert settings.may_act(None)


def test_beyond_this_pc_it_takes_a_certificate_and_users(certificates: Path) -> None:
    files = {"certificate": certificates / "cell", "key": certificates / "cell.key"}
    settings = PageSettings(listen="0.0.0.0:8480", users=USERS, **files)
    assert not [text for text in settings.warnings() if "ends on" not in text]
    assert (settings.may_act("ada"), settings.may_act("eve"), settings.may_act("bob")) == (True, False, False)
    assert not settings.may_act(None)
    assert not PageSettings(listen="0.0.0.0:8480", open=True).may_act(None)


def test_files_that_are_missing_are_warned_of(tmp_path: Path) -> None:
    settings = PageSettings(certificate=tmp_path / "no.pem", key=tmp_path / "no.key")
    first, second = (text for text in settings.warnings() if "cannot be read" in text)
    assert first == f"certificate: {tmp_path}/no.pem cannot be read: No such file or directory"
    assert second.startswith("key: ")


def test_neither_a_password_nor_its_hash_is_shown() -> None:
    settings = PageSettings(users=USERS)
    assert HASH not in repr(settings)
    assert HASH not in settings.model_dump_json()
    for password in (PASSWORD, "scrypt$2$8$1$AAAA$AAAA"):
        with pytest.raises(ValidationError) as caught:
            PageSettings(users={"ada": {"password": password}})
        assert password not in str(caught.value)
    assert PageSettings.model_validate(json.loads(json.dumps(revealed(settings)))) == settings


def test_a_hash_fits_its_password_alone() -> None:
    made = hash_of(PASSWORD, 2**14, 8, 1)
    read = parse(str(made))
    assert read == made
    assert read.fits(PASSWORD)
    for wrong in ("", "Correct horse", PASSWORD + " ", "\ud800", PASSWORD * 1000):
        assert not read.fits(wrong)
    assert hash_of(PASSWORD, 2**14, 8, 1).salt != made.salt
    assert not hash_of("x" * 1024, 2**14, 8, 1).fits("x" * 1025)


def test_a_hash_is_what_every_scrypt_gives() -> None:
    """The third vector of RFC 7914, section 12."""
    known = bytes.fromhex("7023bdcb3afd7348461c06cd81fd38ebfda8fbba904f8e3ea9b543f6545da1f2")
    salt, value = (b64encode(part).decode() for part in (b"SodiumChloride", known))
    assert parse(f"scrypt$16384$8$1${salt}${value}").fits("pleaseletmein")


def test_what_is_no_hash_is_refused() -> None:
    costs = (HASH.replace("16384", cost) for cost in ("16383", "ten", str(2**24)))
    altered = (HASH.replace("scrypt", "bcrypt"), HASH[:-4], HASH.replace("$8$1$", "$8$1000$"))
    for text in ("scrypt$16384$8$1$AAAA", *altered, *costs):
        with pytest.raises(ValueError, match="hash"):
            parse(text)
    for password in ("", "x" * 1025):
        with pytest.raises(ValueError, match="1 to 1024 characters"):
            hash_of(password)


def test_who_comes_through_a_proxy_without_a_login_may_look() -> None:
    settings = PageSettings(names=("weld-3.plant",))
    assert not settings.may_act(None)
    (told,) = settings.warnings()
    assert "sees the cell without a login" in told
    assert PageSettings(names=("weld-3.plant",), users=USERS).warnings() == ()
