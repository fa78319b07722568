"""The device's end of a serial port that disappears and returns: a pseudo-terminal behind a symbolic link."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import struct
import termios
import tty
from pathlib import Path

from cellwatt.emulation.terminal import put_link


class VirtualPort:
    """A pseudo-terminal in raw mode; ``link``, if given, points to it while it is plugged in.

    A client that has ``path`` open sees the port end when ``unplug`` is called, as with a USB adapter. ``flushed``: the
    client has discarded the buffered bytes, as serial libraries do when they open a port.
    """

    def __init__(self, link: Path | None = None) -> None:
        self._link = link
        self._master = -1
        self._slave = ""
        self.flushed = False
        self.plug()

    @property
    def path(self) -> str:
        """Path at which to open the port: the link, or else the terminal itself."""
        return str(self._link or self._slave)

    @property
    def plugged(self) -> bool:
        """True while the port exists."""
        return self._master >= 0

    def plug(self) -> None:
        """Create the port. Raises ``OSError`` if the link's path is in use."""
        master, slave = pty.openpty()
        try:
            tty.setraw(slave)
            self._slave = os.ttyname(slave)
        finally:
            os.close(slave)
        os.set_blocking(master, False)
        fcntl.ioctl(master, termios.TIOCPKT, struct.pack("i", 1))  # to receive flush events
        self._master = master
        if self._link is not None:
            put_link(self._link, self._slave)

    def unplug(self) -> None:
        """Remove the port: a client that has it open gets end of file or an I/O error."""
        if self.plugged:
            if self._link is not None:
                with contextlib.suppress(OSError):
                    self._link.unlink()
            os.close(self._master)
            self._master = -1

    @property
    def opened(self) -> bool:
        """True while a client has the port open."""
        if not self.plugged:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        opened = not any(events & select.POLLHUP for _, events in poll.poll(0))
        self.flushed = self.flushed and opened
        return opened

    @property
    def unread(self) -> int:
        """Number of bytes that the client has not read."""
        if not self.opened:
            return 0
        slave = os.open(self._slave, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            waiting: int = struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, bytes(4)))[0]
            return waiting
        finally:
            os.close(slave)

    def write(self, data: bytes) -> int:
        """Send as many bytes as the line accepts without blocking; return their number."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def read(self) -> bytes:
        """Return bytes written by the client, without blocking."""
        try:
            told = os.read(self._master, 4096)
        except OSError:  # no data, or no client
            return b""
        event, data = told[0], told[1:]
        self.flushed = self.flushed or bool(event & termios.TIOCPKT_FLUSHREAD)
        return data if event == termios.TIOCPKT_DATA else b""
