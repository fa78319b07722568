"""A board at headquarters as a process: ten times a second it says how many blocks of samples came live.

python -m PACKAGE.board '{"site", "link": settings}'
"""

from __future__ import annotations

import json
import sys
import threading

from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from tests.daemon.outlets.zenoh.fake_cell import CELL
from tests.orders import say

if __name__ == "__main__":
    order = json.loads(sys.argv[1])
    over, came = threading.Event(), list[object]()
    with open_session(LinkSettings(**order["link"])) as session:
        session.declare_subscriber(CellKeys(order["site"], CELL).live("raw/**"), came.append)
        say("ready")
        threading.Thread(target=lambda: (sys.stdin.read(), over.set())).start()
        while not over.wait(0.1):
            say({"live": len(came)})
