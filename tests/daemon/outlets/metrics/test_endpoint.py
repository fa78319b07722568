"""The endpoint: its text by strict parsers, and who may read it."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Mapping
from typing import Any

import aiohttp
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from prometheus_client.parser import text_string_to_metric_families as plain_families

from cellwatt.outlets.metrics import MetricsSettings, serving
from cellwatt.outlets.metrics import outlet as outlet_module
from cellwatt.outlets.metrics.catalogue import CATALOGUE
from tests.daemon.outlets.metrics import cell
from tests.daemon.outlets.metrics.cell import health, outlet_of, tell_everything

OPEN = {"Accept": "application/openmetrics-text;version=1.0.0,text/plain;version=0.0.4;q=0.5"}
UNITS = ("seconds", "bytes", "watts", "joules", "hertz")


@pytest.fixture
async def metrics() -> AsyncIterator[str]:
    """The address of an outlet that was told everything."""
    outlet = outlet_of()
    tell_everything(outlet)
    async with cell.serving(outlet) as url:
        yield f"{url}/metrics"


async def answer_of(url: str, **more: Any) -> tuple[int, str, Mapping[str, str]]:
    """Status, text and headers."""
    async with aiohttp.ClientSession() as session, session.get(url, **more) as answer:
        return answer.status, await answer.text(), answer.headers


async def text_of(url: str, headers: dict[str, str]) -> str:
    status, text, _ = await answer_of(url, headers=headers)
    assert status == 200, text
    return text


async def test_text_is_openmetrics(metrics: str) -> None:
    text = await text_of(metrics, OPEN)
    found = {family.name: family for family in text_string_to_metric_families(text)}
    assert {"cellwatt_samples_received", "cellwatt_power_watts", "cellwatt_build"} <= found.keys()
    for name, family in found.items():
        assert family.type == CATALOGUE[name].type
        assert family.documentation == CATALOGUE[name].help
        assert family.unit == next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")
        assert {f"# HELP {name} ", f"# TYPE {name} "} <= set(re.findall(r"^# \w+ \S+ ", text, re.MULTILINE))
        assert {sample.name for sample in family.samples} == {cell.told(CATALOGUE[name])}
    (received,) = found["cellwatt_samples_received"].samples
    assert (received.labels["source"], received.value) == ('a "new"\narm', 1000.0)
    powers = {sample.labels["channel"]: sample.value for sample in found["cellwatt_power_watts"].samples}
    assert powers == {"arm.bus.power": 42.5, "mains.supply.power": 300.0}


async def test_older_readers_get_plain_text(metrics: str) -> None:
    text = await text_of(metrics, {"Accept": "text/plain"})
    found = {family.name: family for family in plain_families(text)}
    assert found["cellwatt_energy_measured_joules"].samples[0].value == 900.0
    assert found["cellwatt_build_info"].type == "gauge"


async def test_many_readers_cost_one_text(metrics: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    real = outlet_module.exposed
    monkeypatch.setattr(outlet_module, "exposed", lambda *a: made.append(a) or real(*a))
    monkeypatch.setattr(serving, "FRESH", 3600.0)
    await asyncio.gather(*(text_of(metrics, OPEN) for _ in range(30)))
    assert len(made) == 1


@pytest.mark.parametrize(
    ("auth", "code"),
    [({}, 401), ({"Authorization": "Bearer t0p"}, 200), ({"Authorization": "Bearer \u00e4\u20ac"}, 401)],
)
async def test_who_may_read(auth: dict[str, str], code: int) -> None:
    outlet = outlet_of(token="t0p")
    outlet.health(health())
    async with cell.serving(outlet) as url:
        status, _, headers = await answer_of(f"{url}/metrics", headers=auth)
        assert (status, "WWW-Authenticate" in headers) == (code, code == 401)


def test_a_short_token_is_warned_of() -> None:
    assert [text.partition(":")[0] for text in MetricsSettings(token="t0p").warnings()] == ["token"]
