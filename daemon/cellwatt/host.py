"""Host names and addresses in settings, and the secrets in addresses."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Final
from urllib.parse import SplitResult, unquote, urlsplit

from pydantic import AfterValidator

LAST_PORT: Final = 65535
LONGEST: Final = 253
"""Largest length of a host name in characters; each label has at most 63 (RFC 1123)."""
_NAME = re.compile(r"(?:(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\.)*(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\.?")
_NUMBERS = re.compile(r"[0-9]+(?:\.[0-9]+)+")
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")


def check_host(host: str) -> str:
    """Return the host unchanged.

    Raises ``ValueError`` if it is neither a host name nor an IP address; the message names a host found in the text.
    """
    if not (mistake := _mistake(host)):
        return host
    alone = _SCHEME.sub("", host.strip(), count=1).partition("/")[0].rpartition("@")[2]
    alone, _, port = alone.partition(":")
    if _mistake(alone):
        raise ValueError(mistake)
    raise ValueError(f"{mistake}; did you mean {alone!r}{', with the port as a separate key' if port else ''}?")


def in_url(host: str) -> str:
    """The host as it is written in a URL: an address of IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def stays_here(host: str) -> bool:
    """True if only programs on this PC can reach a server that listens at ``host``."""
    return host.lower() == "localhost" or (is_address(host) and ipaddress.ip_address(host).is_loopback)


def web_address(url: str, like: str) -> SplitResult:
    """Split a web address of the form ``like``. Raises ``ValueError``, without the address, if it is none."""
    try:
        parts = urlsplit(url)
        good = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        good = False
    if not good or re.search(r"\s", url):
        raise ValueError(f"expected an address like {like}")
    if parts.username is not None or parts.password is not None:
        raise ValueError("write user and password into their own keys, not into the address")
    return parts


def in_the_clear(url: str) -> bool:
    """True if data sent to a web address leave this PC without encryption."""
    parts = urlsplit(url)
    return parts.scheme == "http" and not stays_here(parts.hostname or "")


def check_clear(url: str, *, allowed: bool) -> None:
    """Raise ``ValueError`` if a web address outside this PC has no TLS, unless that is ``allowed``."""
    if in_the_clear(url) and not allowed:
        raise ValueError("http is for this PC alone: use https, or set open: true")


def _mistake(host: str) -> str:
    if len(host) > LONGEST:
        return f"a host name has at most {LONGEST} characters, this one has {len(host):,}"
    if is_address(host):
        return ""
    if _NUMBERS.fullmatch(host):
        return "expected an IP address of four numbers from 0 to 255, like 192.0.2.10"
    return "" if _NAME.fullmatch(host) else "expected a host name or an IP address, like 192.0.2.10 or arm-3.plant"


def is_address(host: str) -> bool:
    """True for an IP address."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


Host = Annotated[str, AfterValidator(check_host)]
"""A host name or an IP address."""


HIDDEN: Final = "***"
SHORTEST: Final = 4
"""Smallest length in characters of secrets that are searched for in texts."""
_HEAD: Final = 12
"""First characters by which a longer secret is recognised where it was cut off."""
_WORD: Final = r"[\w.~%+-]"
_USER: Final = re.compile(r"""(?<=:/)(/?)([^\s'"<>]{0,512})(?=@)""")
"""After two slashes, or after one, which is what a path makes of them."""
_BARE: Final = re.compile(rf"""(?<![\w.+-])({_WORD}{{1,64}}:)([^\s'"<>@/]{{1,512}})(?=@[\w\[])""")
"""A user and password without a scheme in front."""
_QUERY: Final = re.compile(
    rf"""([?&;#]{_WORD}{{0,64}}?(?:sig|token|key|secret|pass|pwd|auth|cred|code|jwt){_WORD}{{0,64}}?=)([^\s&'"<>#;]+)""",
    re.IGNORECASE,
)


def blank(text: str) -> str:
    """Replace the secrets in the addresses of a text."""
    if "@" in text:
        text = _BARE.sub(rf"\1{HIDDEN}", _USER.sub(rf"\1{HIDDEN}", text))
    return _QUERY.sub(rf"\1{HIDDEN}", text) if "=" in text else text


def without(text: str, secrets: Mapping[str, str]) -> str:
    """Replace each secret (key) in a text by its substitute (value), also where it was cut off; then ``blank`` it.

    Secrets of less than 4 characters are not replaced: they occur in ordinary words.
    """
    for secret in sorted(secrets, key=len, reverse=True):  # the longer may hold the shorter
        head, shown, start = secret[:_HEAD], secrets[secret], 0
        while len(head) >= SHORTEST and (start := text.find(head, start)) >= 0:
            piece = text[start : start + len(secret)]
            same = next((n for n, (a, b) in enumerate(zip(piece, secret, strict=False)) if a != b), len(piece))
            if same == len(secret) or same >= _HEAD:
                text = f"{text[:start]}{shown}{text[start + same :]}"
                start += len(shown)
            else:
                start += 1
    return blank(text)


def secrets_of(address: str) -> Iterator[str]:
    """Secrets of an address, as written and URL-decoded."""
    users = [user for _, user in _USER.findall(address)]
    found = [user.partition(":")[2] if ":" in user else user for user in users]
    found += [secret for pattern in (_BARE, _QUERY) for _, secret in pattern.findall(address)]
    for secret in found:
        yield from {secret, unquote(secret)}
