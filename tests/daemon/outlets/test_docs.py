"""The settings on the pages about outlets are right."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from cellwatt.config import load
from tests.docs.pages import Block, blocks
from tests.docs.test_blocks import NEEDED

PAGES = {"mqtt": "mqtt", "historian": "historian", "notify": "notify", "prometheus": "metrics"}
"""Outlet by page."""
ENV = "BROKER_PASSWORD HOME_TOKEN HOOK_SECRET INFLUX_TOKEN LAKE_KEY LAKE_SECRET MAIL_PASSWORD METRICS_TOKEN NTFY_TOKEN"
ALL = [(outlet, block) for page, outlet in PAGES.items() for block in blocks(f"outlets/{page}.md", "yaml")]
OURS = [(outlet, block) for outlet, block in ALL if re.search(rf"^{outlet}:", block.text, re.MULTILINE)]


@pytest.mark.parametrize(("outlet", "block"), OURS, ids=[str(block) for _, block in OURS])
def test_settings_are_right(outlet: str, block: Block, tmp_path: Path) -> None:
    cell = tmp_path / "cell.yaml"
    cell.write_text(f"{block.text}\n{yaml.safe_dump(NEEDED)}")
    settings = load(cell, dict.fromkeys(ENV.split(), "a-long-secret-in-tests")).outlets[outlet].settings
    assert outlet != "historian" or settings.warnings() == ()


def test_each_page_has_settings() -> None:
    assert {outlet for outlet, _ in OURS} == set(PAGES.values())
