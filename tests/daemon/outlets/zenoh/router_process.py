"""A Zenoh router as a process; stands for a plant's."""

from __future__ import annotations

import json
import sys

from cellwatt.outlets.zenoh.link import LinkSettings, open_session

if __name__ == "__main__":
    with open_session(LinkSettings(mode="router", **json.loads(sys.argv[1]))):
        print('"ready"', flush=True)
        sys.stdin.read()
