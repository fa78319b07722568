"""A store that speaks enough of S3 for a lake, on loopback."""

from __future__ import annotations

from dataclasses import dataclass, field
from urllib.parse import unquote
from xml.sax.saxutils import escape

from aiohttp import web

from tests.daemon.outlets.historian.loopback import Loopback


@dataclass
class Bucket(Loopback):
    """Objects by key; ``log`` has each request."""

    objects: dict[str, bytes] = field(default_factory=dict)
    log: list[str] = field(default_factory=list)

    async def take(self, request: web.BaseRequest) -> web.Response:
        body = await request.read()
        key = unquote(request.path).removeprefix("/lake").lstrip("/")
        self.log.append(f"{request.method} {key or '?' + request.query_string}")
        if request.method == "PUT":
            self.objects[key] = _plain(body, request.headers.get("x-amz-content-sha256", ""))
            return web.Response(headers={"ETag": '"1"'})
        if not key:
            return self._listed(request)
        if key not in self.objects:
            return web.Response(status=404)
        content = self.objects[key]
        headers = {"ETag": '"1"', "Last-Modified": "Tue, 24 Nov 2026 12:00:00 GMT", "Accept-Ranges": "bytes"}
        if request.method == "HEAD":
            return web.Response(headers={**headers, "Content-Length": str(len(content))})
        content = content[request.http_range]
        return web.Response(body=content, headers=headers, status=206 if "Range" in request.headers else 200)

    def _listed(self, request: web.BaseRequest) -> web.Response:
        prefix = request.query.get("prefix", "")
        kept = sorted(key for key in self.objects if key.startswith(prefix))
        told = "".join(
            f"<Contents><Key>{escape(key)}</Key><Size>{len(self.objects[key])}</Size>"
            "<LastModified>2026-11-24T12:00:00.000Z</LastModified></Contents>"
            for key in kept
        )
        about = f"<IsTruncated>false</IsTruncated><KeyCount>{len(kept)}</KeyCount>"
        text = f"<ListBucketResult>{about}{told}</ListBucketResult>"
        return web.Response(text=text, content_type="application/xml")


def _plain(body: bytes, told: str) -> bytes:
    """A body without the marks of its chunks."""
    if not told.startswith("STREAMING"):
        return body
    found = b""
    while body:
        size, _, body = body.partition(b"\r\n")
        n = int(size.partition(b";")[0], 16)
        if not n:
            break
        found, body = found + body[:n], body[n + 2 :]
    return found
