"""Facts about the PC that matter to a daemon with deadlines; environment variables are left out."""

from __future__ import annotations

import os
import platform
import resource
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from cellwatt.record.folder import nearest

_FILES: Final = {
    "distribution": "/etc/os-release",
    "clock source": "/sys/devices/system/clocksource/clocksource0/current_clocksource",
    "load": "/proc/loadavg",
    "uptime, s": "/proc/uptime",
    "memory limit of the group": "/sys/fs/cgroup/memory.max",
    "processor limit of the group": "/sys/fs/cgroup/cpu.max",
    "real-time share, us": "/proc/sys/kernel/sched_rt_runtime_us",
}
_LIMITS: Final = {
    "real-time priority": resource.RLIMIT_RTPRIO,
    "locked memory, B": resource.RLIMIT_MEMLOCK,
    "open files": resource.RLIMIT_NOFILE,
}
_SYNCHRONISED: Final = Path("/run/systemd/timesync/synchronized")


def facts(folder: Path | None) -> dict[str, Any]:
    """Facts about the system, processors, clocks, memory, limits, and the disk of ``folder``."""
    return {
        "system": platform.platform(),
        "processor": {"machine": platform.machine(), "model": _line("/proc/cpuinfo", "model name")},
        "cores": {"there": os.cpu_count(), "allowed": len(os.sched_getaffinity(0))},
        "memory": {key: _line("/proc/meminfo", key) for key in ("MemTotal", "MemAvailable", "SwapTotal")},
        "user": {"uid": os.getuid(), "groups": sorted(os.getgroups())},
        "limits (soft, hard)": {name: _limit(number) for name, number in _LIMITS.items()},
        "clocks": {"synchronised by systemd-timesyncd": _SYNCHRONISED.exists()},
        "files": {name: _text(path) for name, path in _FILES.items()},
        "serial ports": sorted(str(p) for p in Path("/dev").glob("tty[UA][SCM]*")),
        "disk": None if folder is None else _disk(folder),
    }


def _text(path: str) -> str:
    try:
        return Path(path).read_text().strip()
    except OSError as error:
        return f"not readable: {error.strerror}"


def _line(path: str, key: str) -> str:
    lines: Iterator[str] = (line for line in _text(path).splitlines() if line.startswith(key))
    return next(lines, "").partition(":")[2].strip()


def _limit(number: int) -> list[str]:
    return ["unlimited" if v == resource.RLIM_INFINITY else str(v) for v in resource.getrlimit(number)]


def _disk(folder: Path) -> dict[str, Any]:
    existing = nearest(folder)
    usage = shutil.disk_usage(existing)
    return {"folder": str(existing), "size, GB": usage.total / 1e9, "free, GB": usage.free / 1e9}
