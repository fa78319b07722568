"""Metadata of a model file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cellwatt.errors import ModelError
from cellwatt_plugins.models.metadata import Metadata, encode
from cellwatt_plugins.onnx_file import decoded
from fuzz.target import Target

PLACE = Path("model.onnx")


def run(data: bytes) -> None:
    """As the text in the file."""
    try:
        found = decoded(data.decode("utf-8", "replace"), Metadata, PLACE)
    except ModelError as error:
        assert "\n" not in str(error)
        return
    assert decoded(encode(found), Metadata, PLACE) == found


def seeds() -> Iterable[bytes]:
    """A model of two inputs."""
    yield (
        b'{"version":1,"name":"power","robot":null,"inputs":[{"channel":"joint_1.position","unit":"rad"},'
        b'{"channel":"bus.power","unit":"W","optional":true}],"outputs":[{"name":"p","unit":"W"}],"rate_hz":50.0,'
        b'"window":3,"delay":1,"training":{"data":"' + b"0" * 64 + b'","range":[[0,1],[0,1]],'
        b'"created":"2026-01-02T03:04:05Z","rows":10}}'
    )


TARGET = Target(run, seeds, 1024)
