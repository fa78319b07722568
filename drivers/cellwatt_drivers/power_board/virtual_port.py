"""The device's end of a serial port that vanishes and comes back: a pseudo-terminal behind a symbolic link."""

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
    """A pseudo-terminal in raw mode; ``link``, where given, points to it while it is plugged in.

    Whoever opens ``path`` sees a port that ends when ``unplug`` is called, as a USB adapter's does.
    ``flushed``: whoever has it open has thrown away what waited in it, as serial libraries do when they open.
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
        """True while the port is there."""
        return self._master >= 0

    def plug(self) -> None:
        """Make the port appear. Raises ``OSError`` where the link's place is taken by something else."""
        master, slave = pty.openpty()
        try:
            tty.setraw(slave)
            self._slave = os.ttyname(slave)
        finally:
            os.close(slave)
        os.set_blocking(master, False)
        fcntl.ioctl(master, termios.TIOCPKT, struct.pack("i", 1))  # to be told of flushes
        self._master = master
        if self._link is not None:
            put_link(self._link, self._slave)

    def unplug(self) -> None:
        """Make the port vanish: who has it open gets end of file or an I/O error."""
        if self.plugged:
            if self._link is not None:
                with contextlib.suppress(OSError):
                    self._link.unlink()
            os.close(self._master)
            self._master = -1

    @property
    def opened(self) -> bool:
        """True while somebody has the port open."""
        if not self.plugged:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        opened = not any(events & select.POLLHUP for _, events in poll.poll(0))
        self.flushed = self.flushed and opened
        return opened

    @property
    def unread(self) -> int:
        """Bytes that wait for whoever has the port open."""
        if not self.opened:
            return 0
        slave = os.open(self._slave, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            waiting: int = struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, bytes(4)))[0]
            return waiting
        finally:
            os.close(slave)

    def write(self, data: bytes) -> int:
        """Send what the line takes without blocking; return how many bytes that was."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def read(self) -> bytes:
        """Return the bytes that the other side wrote, without blocking."""
        try:
            told = os.read(self._master, 4096)
        except OSError:  # nothing there, or nobody at the other end
            return b""
        event, data = told[0], told[1:]
        self.flushed = self.flushed or bool(event & termios.TIOCPKT_FLUSHREAD)
        return data if event == termios.TIOCPKT_DATA else b""
