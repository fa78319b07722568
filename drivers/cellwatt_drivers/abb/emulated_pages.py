"""The web server of an emulated controller: Robot Web Services 1.0 (Digest) or 2.0 (Basic)."""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
import ssl
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress

from cellwatt_drivers.abb import rws
from cellwatt_drivers.abb.emulated_robot import EmulatedRobot, EnergyMeter
from cellwatt_drivers.abb.rws import Item, RobotWare

REALM = "validusers@robapi.abb"
SESSIONS = 70
"""Most sessions that a controller opens."""
_LOCK = Item("pnl-opmode-lockstate-li", "lock-state", {"lockstate": "unlocked"})
"""RobotWare 7 lists more entries than the mode; ``rws2`` reads the first. The others are undocumented."""
Answer = tuple[int, dict[str, str], bytes]


class Pages:
    """Answers requests for pages; ``asked`` counts them by method and path, ``sessions`` are the open sessions."""

    def __init__(
        self,
        robot: EmulatedRobot,
        meter: EnergyMeter | None,
        robotware: RobotWare,
        user: str,
        password: str,
        now: Callable[[], float],
    ) -> None:
        self.asked: Counter[str] = Counter()
        self.sessions: set[str] = set()
        self._robot = robot
        self._meter = meter
        self._robotware: RobotWare = robotware
        self._user, self._password = user, password
        self._now = now
        self._nonce = secrets.token_hex(8)

    def answer(self, method: str, target: str, fields: Mapping[str, str]) -> Answer:
        """Status, headers and body for a request; ``fields`` are its headers, names in lower case."""
        path = target.partition("?")[0]
        cookie, authorization = fields.get("cookie", ""), fields.get("authorization", "")
        self.asked[f"{method} {path}"] += 1
        session = re.search(r"-http-session-=(\w+)", cookie)
        if session is None or session[1] not in self.sessions:
            if not self._authorized(method, authorization):
                return 401, {"WWW-Authenticate": self._challenge()}, b""
            if len(self.sessions) >= SESSIONS:
                return 503, {}, b""
            name = secrets.token_hex(8)
            self.sessions.add(name)
            headers = {"Set-Cookie": f"-http-session-={name}; path=/; httponly"}
        else:
            name, headers = session[1], {}
        if path == rws.LOGOUT:
            self.sessions.discard(name)
            return 200, headers, b""
        if method != "GET":
            return 405, headers, b""
        entries = self._entries(path)
        if entries is None:
            return 404, headers, b""
        return 200, headers, rws.page(path.rpartition("/")[2], entries)

    def _challenge(self) -> str:
        if self._robotware == 7:
            return f'Basic realm="{REALM}"'
        return f'Digest realm="{REALM}", domain="/", nonce="{self._nonce}", algorithm="MD5", qop="auth"'

    def _authorized(self, method: str, authorization: str) -> bool:
        scheme, _, rest = authorization.partition(" ")
        if not self._password:
            return bool(rest)
        if self._robotware == 7:
            with suppress(ValueError):
                return scheme == "Basic" and base64.b64decode(rest).decode() == f"{self._user}:{self._password}"
            return False
        given = {k: a or b for k, a, b in re.findall(r'(\w+)=(?:"([^"]*)"|([^\s,]+))', rest)}
        if scheme != "Digest" or given.get("nonce") != self._nonce or given.get("username") != self._user:
            return False
        first = _md5(f"{self._user}:{REALM}:{self._password}")
        second = _md5(f"{method}:{given.get('uri', '')}")
        middle = f"{self._nonce}:{given.get('nc')}:{given.get('cnonce')}:{given.get('qop')}"
        return secrets.compare_digest(given.get("response", ""), _md5(f"{first}:{middle}:{second}"))

    def _entries(self, path: str) -> tuple[Item, ...] | None:
        """Return the entries of a page; ``None`` if there is no such page."""
        robot = self._robot
        match path:
            case rws.MODE:
                mode = Item("pnl-opmode", "opmode", {"opmode": "AUTO"})
                return (mode,) if self._robotware == 6 else (mode, _LOCK)
            case rws.SPEED:
                return (Item("pnl-speedratio", "speedratio", {"speedratio": "100"}),)
            case rws.EXECUTION:
                running = {"ctrlexecstate": "running" if robot.running else "stopped", "cycle": "forever"}
                return (Item("rap-execution", "execution", running),)
            case rws.SYSTEM:
                version = {6: "6.15.04.00", 7: "7.15.0"}[self._robotware]
                kind = "sys-system-li" if self._robotware == 6 else "sys-system"
                return (Item(kind, "system", {"name": "EMULATED", "rwversion": version}),)
            case rws.ENERGY:
                return None if self._meter is None else self._energy(self._meter)
        page = rws.CONTROLLER[self._robotware]
        if path != page:
            return None
        return (
            Item("pnl-ctrlstate", page.rpartition("/")[2], {"ctrlstate": "motoron" if robot.motors_on else "motoroff"}),
        )

    def _energy(self, meter: EnergyMeter) -> tuple[Item, ...]:
        meter.advance(self._now())
        state = {
            "state": "0" if meter.count else "-1",
            "energy-state": "not-paused",
            "change-count": str(meter.count),
            "time-stamp": "0",
            "reset-time": "0",
            "interval-length": str(meter.length),
            "interval-energy": f"{meter.interval:.4f}",
            "accumulated-energy": f"{meter.accumulated:.4f}",
        }
        axes = tuple(
            Item("sys-energy-axis-li", str(i), {"interval-energy": f"{joule:.4f}"})
            for i, joule in enumerate(meter.joints, 1)
        )
        robot = Item("sys-energy-mec-li", "ROB_1", {}, axes)
        return Item("sys-energy-state-li", "energy-state", state), robot


def tls(certificate: str) -> ssl.SSLContext:
    """TLS context of the server, from a file with key and certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate)
    return context


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()
