"""The libraries behind channels are loaded when the outlet runs, and their absence is told with the extra."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import importlib.util, sys
from cellwatt.errors import ConfigError
from cellwatt.registry import outlet
outlet("notify")
print(sorted({"aiohttp", "aiosmtplib"} & set(sys.modules)))
del sys.modules["cellwatt.outlets.notify.outlet"]
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name == "aiosmtplib" else find(name, package)
try:
    outlet("notify")
except ConfigError as error:
    print(error)
"""


def test_light_and_missing() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "[]",
        "outlet 'notify' needs the package aiosmtplib: pip install 'cellwatt[notify]'",
    ]
