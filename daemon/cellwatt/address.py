"""Secrets within addresses: users with passwords, and signatures, keys and tokens in queries."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final
from urllib.parse import unquote

HIDDEN: Final = "***"
SHORTEST: Final = 4
"""Characters of a secret from which on it is looked for in texts."""
_HEAD: Final = 12
"""Characters of a longer secret by which one that was cut off is known."""
_WORD: Final = r"[\w.~%+-]"
_USER: Final = re.compile(r"""(?<=:/)(/?)([^\s'"<>]{0,512})(?=@)""")
"""After two slashes, or the one that is left of them in a path."""
_BARE: Final = re.compile(rf"""(?<![\w.+-])({_WORD}{{1,64}}:)([^\s'"<>@/]{{1,512}})(?=@[\w\[])""")
"""A user and password without a scheme in front."""
_QUERY: Final = re.compile(
    rf"""([?&;#]{_WORD}{{0,64}}?(?:sig|token|key|secret|pass|pwd|auth|cred|code|jwt){_WORD}{{0,64}}?=)([^\s&'"<>#;]+)""",
    re.IGNORECASE,
)


def blank(text: str) -> str:
    """A text without the secrets of the addresses in it."""
    if "@" in text:
        text = _BARE.sub(rf"\1{HIDDEN}", _USER.sub(rf"\1{HIDDEN}", text))
    return _QUERY.sub(rf"\1{HIDDEN}", text) if "=" in text else text


def without(text: str, secrets: Mapping[str, str]) -> str:
    """A text with what to show in place of each secret, also of one that was cut off, and ``blank``.

    Those of less than 4 characters stay: they are part of ordinary words.
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
    """Secrets of an address, as they are written and as they are meant."""
    users = [user for _, user in _USER.findall(address)]
    found = [user.partition(":")[2] if ":" in user else user for user in users]
    found += [secret for pattern in (_BARE, _QUERY) for _, secret in pattern.findall(address)]
    for secret in found:
        yield from {secret, unquote(secret)}
