"""Plotly figures as SVG: drawn by a browser without a window, since plotly itself draws in JavaScript only."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from plotly.offline import get_plotlyjs

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
LIMIT = 120.0
"""s that the browser may take."""
_DRAW = """
Promise.all(figures.map(f => Plotly.toImage(f, {format: "svg", width: f.layout.width, height: f.layout.height})))
  .then(all => { document.body.textContent = JSON.stringify(all); });
"""


class BrowserError(Exception):
    """No browser, or it drew nothing."""


def drawn(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """SVG text of each figure. Raises ``BrowserError``."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise BrowserError(f"pictures need a browser, one of {', '.join(BROWSERS)}")
    script = f"const figures = {json.dumps(list(figures.values()), allow_nan=False)};{_DRAW}"
    page = f"<!doctype html><meta charset=utf-8><body><script>{get_plotlyjs()}</script><script>{script}</script>"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.html"
        file.write_text(page)
        options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}/profile"]
        command = [browser, *options, "--virtual-time-budget=20000", "--dump-dom", file.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    body = re.search(r"<body[^>]*>\s*(\[.*\])\s*</body>", done.stdout, re.DOTALL)
    if body is None:
        raise BrowserError(f"{browser} drew nothing: {done.stderr.strip()[-200:]}")
    images = json.loads(html.unescape(body.group(1)))
    return {name: unquote(image.split(",", 1)[1]) for name, image in zip(figures, images, strict=True)}
