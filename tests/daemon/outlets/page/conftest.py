"""A browser for the tests of the page."""

from __future__ import annotations

from collections.abc import AsyncIterator

import aiohttp
import pytest

from tests.daemon.outlets.page.cell import client


@pytest.fixture
async def browser() -> AsyncIterator[aiohttp.ClientSession]:
    async with client() as found:
        yield found
