"""A Zenoh router as a process: the router of ``zenohd``, with a file of its, in a folder.

python -m PACKAGE.router '{"folder": …, "file": …, "options": {path: value}}'
"""

from __future__ import annotations

import json
import os
import sys

import zenoh

if __name__ == "__main__":
    order = json.loads(sys.argv[1])
    os.chdir(order["folder"])
    zenoh.try_init_log_from_env()
    config = zenoh.Config.from_file(order["file"])
    # All namespaces are of one machine: routers would pass data through shared memory, past every line that is cut.
    for path, value in {**order["options"], "transport/shared_memory/enabled": False}.items():
        config.insert_json5(path, json.dumps(value))
    with zenoh.open(config):
        print('"ready"', flush=True)
        sys.stdin.read()
