"""Outlets beside the plain library of the same protocol: throughput, loss, and what a server that hangs costs.

python bench/outlets.py [mqtt metrics historian opc_ua blocked] [--json | --markdown] [--seconds 5] [--repeats 3]

Each outlet is one module of the package `outlet` that gives its figures by name; without names all are measured. Where
its server is not installed, an outlet says so instead. Figures are the median of the repeats, with the least and most.

``mqtt``: rows of 60 channels as JSON to Mosquitto on this host, as fast as they go, counted by a subscriber in a
process of its own; ``plain`` publishes the same payloads with aiomqtt, one after the other (as its documentation shows)
or 64 at a time (as the outlet does). ``lost`` is the share of the offered rows that the subscriber did not get.
``lateness`` is that of a ticker of 1 kHz on the loop beside 50 rows a second, and the longest computing of one step of
that loop: without an outlet, with a broker that answers, and with one that takes the connection and then hangs.

``metrics``: answers a second of the endpoint for a cell of 16 sources and 60 channels to one client, beside what
prometheus-client's own server gives for as many series; bytes and processor time of one text.

``historian``: rows of 60 channels to Debian's InfluxDB, as fast as they go, beside the same lines posted with aiohttp
in the same batches; then what fills in from a record: rows a second into InfluxDB, and into a lake of Parquet files.

``opc_ua``: 60 channels from the outlet's server process to one subscribed client of asyncua, beside a plain server of
asyncua in a process of its own that writes the same values: values received a second, the share of the offered ones
that were lost, and processor time of the process that serves.

``blocked``: a whole daemon without outlets, with MQTT, InfluxDB and webhook outlets whose servers take connections and
never answer, and with servers that answer: losses, processor time of each process, memory, and age of frames at a
subscriber.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from importlib import import_module
from typing import Any

OUTLETS = ("mqtt", "metrics", "historian", "opc_ua", "blocked")


def rounded(figure: Any) -> Any:
    """A figure as it is printed."""
    if isinstance(figure, dict):
        return {name: rounded(value) for name, value in figure.items()}
    return round(figure, 4) if isinstance(figure, float) else figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("outlets", nargs="*", choices=[[], *OUTLETS])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true", help="the tables of docs/performance.md")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--repeats", type=int, default=3)
    asked = parser.parse_args()
    found: dict[str, Any] = {}
    for name in asked.outlets or OUTLETS:
        began = time.monotonic()
        found[name] = import_module(f"outlet.{name}").measure(asked.seconds, asked.repeats)
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    if asked.markdown:
        from outlet.page import markdown

        print(markdown(found))
    elif asked.json:
        print(json.dumps(rounded(found)))
    else:
        for name, figures in found.items():
            for what, figure in figures.items():
                print(name, what, json.dumps(rounded(figure)))


if __name__ == "__main__":
    main()
