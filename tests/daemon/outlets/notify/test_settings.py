"""Settings that are right, and those that would send in the clear or to nobody."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from cellwatt.outlets.notify.settings import NotifySettings

MAIL = {"host": "mail.plant.example", "from": "cell@plant.example", "to": ["shift@plant.example"]}
HOME = {"url": "https://home.plant.example:8123", "service": "mobile_app_shift", "token": "geheim-1"}


def notify(to: Any, **more: Any) -> NotifySettings:
    return NotifySettings.model_validate({"to": {"shift": to}, **more})


def test_ports_places_and_addresses() -> None:
    assert notify({"mail": MAIL}).to["shift"].place == "mail by mail.plant.example:587"
    assert notify({"mail": {**MAIL, "tls": "tls"}}).to["shift"].place == "mail by mail.plant.example:465"
    hook = notify({"webhook": {"url": "https://hooks.plant.example/T0/geheim-2"}})
    assert hook.to["shift"].place == "webhook by https://hooks.plant.example"
    home = notify({"home_assistant": HOME}).to["shift"]
    assert home.channel.address == "https://home.plant.example:8123/api/services/notify/mobile_app_shift"  # type: ignore[union-attr]
    assert home.secrets[-1] == "geheim-1"


def test_no_secret_in_any_words_about_settings() -> None:
    made = notify({"webhook": {"url": "https://hooks.plant.example/geheim-3", "secret": "geheim-4"}})
    assert "geheim" not in f"{made!r} {made} {made.warnings()} {made.to['shift'].place}"


@pytest.mark.parametrize(
    "to",
    [
        {},
        {"mail": MAIL, "webhook": {"url": "https://a.example"}},
        {"mail": {**MAIL, "tls": "none"}},
        {"mail": {**MAIL, "user": "cell"}},
        {"mail": {**MAIL, "to": ["a@b.example\nBcc: c@d.example"]}},
        {"webhook": {"url": "http://plant.example/geheim"}},
        {"webhook": {"url": "https://user:geheim@plant.example"}},
        {"webhook": {"url": "https://[geheim"}},
        {"ntfy": {"url": "http://plant.example", "topic": "alarms"}},
        {"mail": MAIL, "repeat": "1 s"},
    ],
)
def test_refuses(to: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as refused:
        notify(to)
    assert "geheim" not in str(refused.value)


def test_open_allows_http_and_warns() -> None:
    made = notify({"ntfy": {"url": "http://plant.example", "topic": "geheim", "open": True}})
    assert made.warnings() == ("to.shift: http://plant.example: alarms and tokens are sent unencrypted (open: true)",)
    assert not notify({"webhook": {"url": "http://127.0.0.1:8000/"}}).warnings()


def test_warns_of_an_authority_that_cannot_be_read(tmp_path: Path) -> None:
    made = notify({"mail": {**MAIL, "ca": str(tmp_path / "ca.pem")}})
    assert made.warnings() == (f"to.shift: ca: {tmp_path}/ca.pem cannot be read: No such file or directory",)


NOWHERE, UNNAMED = {"to": {}}, {"to": {"a b": {"mail": MAIL}}}
PAGES = ({"page": "weld-3"}, {"page": "https://a.example/?token=1"})


@pytest.mark.parametrize("more", [*PAGES, {"zone": "Mars"}, {"timeout": "0 s"}, NOWHERE, UNNAMED])
def test_refuses_the_rest(more: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        NotifySettings.model_validate({"to": {"shift": {"mail": MAIL}}, **more})
