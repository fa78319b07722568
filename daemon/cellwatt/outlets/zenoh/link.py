"""Zenoh sessions: settings, opening, and the reason when opening fails.

zenoh is imported on first use. A session listens, and scouts, only if the settings say so.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, SecretStr, model_validator

from cellwatt.config.secret import SecretKeys
from cellwatt.errors import OutletError
from cellwatt.files import unreadable
from cellwatt.host import LAST_PORT, check_host
from cellwatt.outlet import OutletSettings, both_or_neither
from cellwatt.section import Certified

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger(__name__)

LARGEST_MESSAGE: Final = 64 * 1024 * 1024
"""Most bytes of an accepted message; 2000 samples of 1000 channels take 36 MB. Zenoh's own limit is 1 GiB."""
_ATTEMPT: Final = 1.0
"""Longest time, s, of the first attempt at a router; later attempts have twice that, for a router that is starting
or overloaded. A stop waits for the attempt."""
PATIENCE: Final = 10.0
"""Time, s, that a client tries to reach its router."""
_PAUSE: Final = 0.2  # s
_PROBE: Final = 1.0  # s
ADDRESS = re.compile(r"(tcp|udp|tls|quic|ws)/([^/]+):(\d+)(?:[?#].*)?")
_OTHER_ADDRESS = re.compile(r"(unixsock-stream|unixpipe|serial|vsock)/.+")
_ZENOH_DETAIL = re.compile(r'msg: "((?:[^"\\]|\\.)*)"|Str\("([^"]*)"\)')
_ZENOH_PLACE = re.compile(r"\s*at /\S+:\d+\.?")


_QUEUE: Final = "transport/link/tx/queue"
_QUEUES: Final = (
    # One receiver's queue of samples, in batches of 64 kB allocated on demand: a receiver that is not scheduled for
    # some milliseconds must not lose samples.
    (f"{_QUEUE}/size/data", 16),
    # While it is full, a put waits this long, µs; then this receiver's samples are dropped until it accepts some again.
    # So a receiver that hangs delays the others once by this time, and a slow one by little more.
    (f"{_QUEUE}/congestion_control/drop/wait_before_drop", 5_000),
    # One receiver's queue of results: some thousands. A receiver that accepts none for this long, µs, while it is full
    # is disconnected and must request the messages that it missed.
    (f"{_QUEUE}/size/interactive_high", 16),
    (f"{_QUEUE}/congestion_control/block/wait_before_close", 1_000_000),
)


_SECRET: Final = SecretKeys(("password", "private_key", "secret"))
"""Zenoh's own options that are secrets."""


class TlsSettings(Certified):
    """Certificates in PEM files."""

    root_ca: Path
    """Authority that signed the peer's certificate."""
    certificate: Path | None = None
    """This session's certificate: needed to listen, and to connect to a router that requires one."""
    key: Path | None = None
    """Private key of ``certificate``."""
    mutual: bool = True
    """When listening, require the peer's certificate; when connecting, present ``certificate``."""
    verify_name: bool = True
    """Require that the peer's certificate names the host of the endpoint."""

    @model_validator(mode="after")
    def _paired(self) -> TlsSettings:
        both_or_neither(certificate=self.certificate, key=self.key)
        return self


def _endpoint(endpoint: str) -> str:
    found = ADDRESS.fullmatch(endpoint)
    if not _OTHER_ADDRESS.fullmatch(endpoint) and (found is None or int(found[3]) > LAST_PORT):
        raise ValueError(f"{endpoint!r} is not an endpoint; expected protocol/host:port, like tcp/192.0.2.1:7447")
    if _SECRET.name(endpoint.partition("#")[2]):
        raise ValueError("a secret in an endpoint is shown with it: use tls: {key: FILE, …}, user and password")
    if found is not None:
        check_host(found[2].strip("[]"))
    return endpoint


_Endpoint = Annotated[str, AfterValidator(_endpoint)]


class LinkSettings(OutletSettings):
    """Settings of a Zenoh session."""

    mode: Literal["peer", "client", "router"] = "peer"
    """``peer`` serves those that connect, ``client`` goes through a router, ``router`` also relays for others."""
    listen: tuple[_Endpoint, ...] = ()
    """Endpoints to listen on, like ``tcp/127.0.0.1:7447``; none by default, so nothing is exposed."""
    connect: tuple[_Endpoint, ...] = ()
    """Endpoints to connect to, like ``tls/plant-router:7447``; retried without limit while they are unreachable."""
    tls: TlsSettings | None = None
    """Certificates for ``tls/`` and ``quic/`` endpoints."""
    user: str | None = None
    """User name for the endpoints in ``connect``."""
    password: SecretStr | None = None
    """Password of the user; write ``${NAME}`` and set it in the environment."""
    options: Annotated[Mapping[str, Any], _SECRET] = Field(default_factory=dict, repr=False)
    """Any other Zenoh configuration by path, like ``access_control: {…}`` or ``transport/link/tx/lease: 5000``."""

    @model_validator(mode="after")
    def _accepted(self) -> LinkSettings:
        if self.mode == "client" and not self.connect:
            raise ValueError("mode client needs an endpoint in connect, like tcp/plant-router:7447")
        both_or_neither(user=self.user, password=self.password)
        secure = [e for e in (*self.listen, *self.connect) if e.startswith(("tls/", "quic/"))]
        if secure and self.tls is None:
            raise ValueError(f"{secure[0]} needs tls: {{root_ca: FILE, …}}")
        served = [e for e in self.listen if e in secure]
        if served and self.tls is not None and self.tls.certificate is None:
            raise ValueError(f"to listen, {served[0]} needs tls: {{root_ca: FILE, certificate: FILE, key: FILE}}")
        session_config(self)
        return self

    @property
    def files(self) -> Mapping[str, Path | None]:
        """Files that the session needs, by option."""
        tls = self.tls
        return {"tls.root_ca": tls.root_ca, "tls.certificate": tls.certificate, "tls.key": tls.key} if tls else {}


def session_config(settings: LinkSettings, timeout: float = _ATTEMPT, largest: int = LARGEST_MESSAGE) -> zenoh.Config:
    """Zenoh's configuration: ``timeout`` s to reach a router, messages of up to ``largest`` bytes.

    Raises ``ValueError`` that names the option that Zenoh refuses.
    """
    import zenoh

    config = zenoh.Config()
    for path, value in _options(settings, timeout, largest):
        try:
            config.insert_json5(path, json.dumps(value))
        except zenoh.ZError as error:
            raise ValueError(f"Zenoh refuses {_where(path)} = {_shown(path, value)}: {_plain(error)}") from None
    return config


def open_session(
    settings: LinkSettings,
    stopped: Callable[[], bool] = lambda: False,
    patience: float | None = None,
    largest: int = LARGEST_MESSAGE,
) -> zenoh.Session:
    """Open a session; blocks, so call it in a thread.

    A client tries its endpoints in turn for ``patience`` s (default ``PATIENCE``). Raises ``OutletError`` with what to
    check for each endpoint, also when ``stopped()`` becomes true. Fragmented messages (Zenoh's fragments hold 64 kB)
    of more than ``largest`` bytes are discarded before they are reassembled.
    """
    import zenoh

    zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
    for problem in unreadable(settings.files):
        raise OutletError(problem)
    end = time.monotonic() + (PATIENCE if patience is None else patience)
    order = settings.connect or ("",)
    reasons = dict.fromkeys(order, "")
    for at in itertools.cycle(range(len(order))):
        # Zenoh gives up at the first unreachable endpoint: put each first in turn. The session has all of them.
        first = order[at]
        turned = settings.model_copy(update={"connect": settings.connect[at:] + settings.connect[:at]})
        try:
            return zenoh.open(session_config(turned, _ATTEMPT * (2 if reasons[first] else 1), largest))
        except zenoh.ZError as error:
            text = _plain(error)
        if "Unable to connect" not in text:
            raise OutletError(f"Zenoh session: {text}")
        reasons[first] = f"{first}: {_probe(first) or _REFUSED}"
        if stopped() or (time.monotonic() > end and all(reasons.values())):
            raise OutletError("; ".join(filter(None, reasons.values())))
        time.sleep(_PAUSE)
    raise AssertionError("a cycle has no end")


async def open_beside(settings: LinkSettings, largest: int = LARGEST_MESSAGE) -> zenoh.Session:
    """``open_session`` in a thread; a cancellation waits for the thread."""
    stopped = threading.Event()
    opening = asyncio.ensure_future(asyncio.to_thread(open_session, settings, stopped.is_set, largest=largest))
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:
        stopped.set()
        await asyncio.wait([opening])
        if opening.exception() is None:
            await asyncio.to_thread(close_session, opening.result())
        raise


def close_session(session: zenoh.Session) -> None:
    """Close a session; blocks while messages are still being sent."""
    import zenoh

    try:
        session.close()  # type: ignore[no-untyped-call]
    except zenoh.ZError as error:
        log.warning("zenoh: the session did not close in order: %s", error)


def _options(settings: LinkSettings, timeout: float, largest: int) -> Iterator[tuple[str, Any]]:
    yield "mode", settings.mode
    yield "listen/endpoints", settings.listen
    yield "connect/endpoints", settings.connect
    if settings.mode == "client":
        yield "connect/timeout_ms", round(1e3 * timeout)
    yield "scouting/multicast/enabled", False
    yield "scouting/gossip/enabled", False
    yield "scouting/delay", 0
    # Shared memory gains nothing at these message sizes and costs 30 MB; put() took up to 24 ms with it.
    yield "transport/shared_memory/enabled", False
    yield "transport/link/rx/max_message_size", largest
    yield from _QUEUES
    yield from _tls(settings.tls)
    if settings.user is not None and settings.password is not None:
        yield "transport/auth/usrpwd/user", settings.user
        yield "transport/auth/usrpwd/password", settings.password.get_secret_value()
    yield from settings.options.items()


def _tls(tls: TlsSettings | None) -> Iterator[tuple[str, Any]]:
    if tls is None:
        return
    at = "transport/link/tls"
    yield f"{at}/root_ca_certificate", str(tls.root_ca)
    yield f"{at}/verify_name_on_connect", tls.verify_name
    if tls.certificate is not None:
        for role in ("listen", "connect"):
            yield f"{at}/{role}_certificate", str(tls.certificate)
            yield f"{at}/{role}_private_key", str(tls.key)
        yield f"{at}/enable_mtls", tls.mutual


def _where(path: str) -> str:
    named = {"listen/endpoints": "listen", "connect/endpoints": "connect", "mode": "mode"}
    return named.get(path, f"options: {path}")


def _shown(path: str, value: object) -> str:
    return "…" if _SECRET.name(path) else json.dumps(value)


def _plain(error: Exception) -> str:
    """Zenoh's error text without positions in its source code."""
    text = str(error)
    found = _ZENOH_DETAIL.search(text)
    return _ZENOH_PLACE.sub("", (found[1] or found[2]) if found else text).strip()


def why_unconnected(settings: LinkSettings) -> str:
    """Reason why a session has no link to any endpoint in ``connect``. Blocks for up to 1 s per endpoint."""
    return "; ".join(f"{endpoint}: {_probe(endpoint) or _REFUSED}" for endpoint in settings.connect)


_REFUSED: Final = (
    "the port answers but refuses the session: check user and password, the certificates, and that this is a Zenoh port"
)


def _probe(endpoint: str) -> str | None:
    """Reason why an endpoint does not accept a plain TCP connection; ``None`` if it does."""
    found = ADDRESS.fullmatch(endpoint)
    if found is None or found[1] not in ("tcp", "tls", "ws"):
        return "no Zenoh session could be opened there"
    try:
        socket.create_connection((found[2].strip("[]"), int(found[3])), timeout=_PROBE).close()
    except TimeoutError:
        return "no answer; is the address right and the host running?"
    except socket.gaierror:
        return f"the host name {found[2]!r} is not known"
    except OSError as error:
        return f"no answer ({(error.strerror or str(error)).lower()})"
    return None
