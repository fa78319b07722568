"""What tests of several packages of the daemon share."""

from __future__ import annotations

import ssl
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cellwatt import registry

if TYPE_CHECKING:
    from cellwatt.outlets.zenoh.link import LinkSettings

Registered = Callable[[Callable[[str], Any]], None]


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[Registered]:
    """Puts another function in place of ``importlib.metadata.entry_points``."""

    def put(entry_points: Callable[[str], Any]) -> None:
        monkeypatch.setattr(registry, "entry_points", entry_points)
        registry.available.cache_clear()

    yield put
    registry.available.cache_clear()


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """A folder with two cells' keys."""
    from cellwatt.door.signing import new_key

    for name in ("cell", "other"):
        private, public = new_key()
        (tmp_path / f"{name}.key").write_bytes(private)
        (tmp_path / f"{name}.pub").write_bytes(public)
    return tmp_path


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an authority's certificate ``ca``, and ``cell`` and ``cell.key`` for this PC."""
    from tests.daemon.door.made import write_certificates

    return write_certificates(tmp_path_factory.mktemp("certificates"))


@pytest.fixture(scope="session")
def tls(certificates: Path) -> ssl.SSLContext:
    """A server's side of TLS by these certificates."""
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(certificates / "cell", certificates / "cell.key")
    return context


@pytest.fixture
def bus() -> Iterator[LinkSettings]:
    """A Zenoh router that lets everybody do everything, and how to reach it."""
    from cellwatt.outlets.zenoh.link import LinkSettings, open_session
    from tests.daemon.outlets.zenoh.processes import free_port

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session(LinkSettings(mode="router", listen=(endpoint,))):
        yield LinkSettings(mode="client", connect=(endpoint,))
