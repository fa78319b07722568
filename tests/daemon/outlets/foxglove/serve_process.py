"""``serve`` as a process: arguments are the cell's port and its own; ends when stdin is closed."""

from __future__ import annotations

import _thread
import signal
import sys
import threading

from cellwatt.errors import CellwattError
from cellwatt.outlets.foxglove import serve
from cellwatt.subscriber import LinkSettings
from tests.daemon.outlets.zenoh.fake_cell import CELL, SITE


def main() -> None:
    link = LinkSettings(mode="client", connect=(f"tcp/127.0.0.1:{sys.argv[1]}",))
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    threading.Thread(target=lambda: (sys.stdin.read(), _thread.interrupt_main()), daemon=True).start()
    try:
        serve(link, SITE, CELL, port=int(sys.argv[2]), tell=lambda line: print(line, flush=True))
    except KeyboardInterrupt:
        print("ended", flush=True)
    except CellwattError as error:
        print(error, flush=True)


if __name__ == "__main__":
    main()
