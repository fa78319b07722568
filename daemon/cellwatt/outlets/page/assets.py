"""The built files of the page, kept in memory: nothing but them can be asked for."""

from __future__ import annotations

import gzip
import hashlib
import mimetypes
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Final

from aiohttp import web

from cellwatt.outlets.page.access import refusal

FOLDER: Final = Path(__file__).parent / "static"
INDEX: Final = "index.html"
_SMALL: Final = 1024
"""Bytes below which nothing is packed."""
_IMMUTABLE: Final = "public, max-age=31536000, immutable"
_TYPES: Final = {".js": "text/javascript", ".woff2": "font/woff2", ".webmanifest": "application/manifest+json"}


@dataclass(frozen=True, slots=True)
class Asset:
    """One file, also packed, if that makes it smaller."""

    body: bytes
    packed: bytes | None
    type: str
    tag: str


class Assets:
    """The files of a folder by their path in it."""

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder
        self._kept: dict[str, Asset] = {}

    def load(self) -> None:
        """Read all files; blocks."""
        files = [path for path in sorted(self._folder.rglob("*")) if path.is_file()]
        self._kept = {path.relative_to(self._folder).as_posix(): _asset(path) for path in files}

    def answer(self, request: web.Request, name: str) -> web.StreamResponse:
        """The file of a name; one below ``assets`` has its digest in its name and never changes."""
        asset = self._kept.get(name)
        if asset is None:
            if name == INDEX:
                return refusal(HTTPStatus.SERVICE_UNAVAILABLE, "the files of the page are missing: install it again")
            return refusal(HTTPStatus.NOT_FOUND, "there is no such file")
        kept = _IMMUTABLE if name.startswith("assets/") else "no-cache"
        headers = {"Cache-Control": kept, "ETag": asset.tag, "Vary": "Accept-Encoding", "Content-Type": asset.type}
        if request.headers.get("If-None-Match") == asset.tag:
            return web.Response(status=HTTPStatus.NOT_MODIFIED, headers=headers)
        if asset.packed is not None and "gzip" in request.headers.get("Accept-Encoding", ""):
            return web.Response(body=asset.packed, headers={**headers, "Content-Encoding": "gzip"})
        return web.Response(body=asset.body, headers=headers)


def _asset(path: Path) -> Asset:
    body = path.read_bytes()
    packed = gzip.compress(body, 9, mtime=0) if len(body) > _SMALL else body
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    if kind.startswith("text/"):
        kind = f"{kind}; charset=utf-8"
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    return Asset(body, packed if len(packed) < len(body) else None, kind, tag)
