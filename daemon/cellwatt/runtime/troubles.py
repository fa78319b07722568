"""Alarms about the daemon itself: a source is down or slow, samples are not accounted for, …"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from cellwatt.alarms import AlarmBook, Patience
from cellwatt.door.port import TURNED_AWAY
from cellwatt.door.tries import FAILED, REFUSED
from cellwatt.results import Alarm, Severity
from cellwatt.slots import HOST

PATIENCE: Final = 3
"""Consecutive checks, about one a second, that must agree before an alarm is raised or cleared."""
AGREED: Final = Patience(PATIENCE)
STEADY: Final = Patience(PATIENCE, 15.0)
"""Before the alarm of a source is cleared, the source must have run this long: a source that comes and goes is one
alarm."""
SPAN: Final = 10.0
"""s over which the samples of a source and the dropped frames of a stage are counted."""
HANGS: Final = 120.0
"""Longest time in s that a source may take to connect or to fail: its driver, or a call into the system, hangs."""
FEWEST: Final = 10
"""Smallest number of samples due at which the rate of a stream is checked."""
LEAST: Final = 0.9
"""Smallest share of the samples due that a stream must deliver."""
STRANGE: Final = 0.01
"""Largest share of the samples due that may be duplicates, malformed, late … without an alarm."""
FEWEST_STRANGE: Final = 5
"""Number that is allowed in any case, where that share is less."""
FLOOD: Final = 50
"""Connections that a server refused or closed within ``SPAN``: more than browsers cause when they lose the network."""
PERIODS: Final = 3
"""Periods of a slow stream without a sample after which it counts as sending no values."""
MOST_NAMED: Final = 5
"""Largest number of channels that an alarm names."""
RESETS: Final = 3
"""Resets of a device's clock within ``SPAN`` that raise ``clock_unsteady``."""
APART: Final = 1.0
"""Largest difference in s between the cell's time and the PC's clock: more means that the PC's clock was set."""
UNSURE: Final = 0.05
"""Largest bound of the time stamps in s for a device with a clock of its own; frames are 20 ms apart."""


KINDS: Final = {
    "source_down": "source {part} responds again",
    "source_silent": "source {part} sends values",
    "source_blank": "source {part} sends values for all of its channels",
    "source_slow": "source {part} delivers its declared rate again",
    "source_strange": "source {part} sends valid data only",
    "clock_unsure": "the time stamps of source {part} are accurate enough again",
    "clock_unsteady": "the clock of source {part} is steady again",
    "accounting": "all samples of source {part} are accounted for",
    "stage_broken": "stage {part} runs again",
    "stage_slow": "stage {part} keeps up again",
    "sink_down": "outlet {part} works again",
    "process_down": "the process for {part} responds again",
    "process_slow": "the process for {part} keeps up again",
    "pc_slow": "this PC keeps up again",
    "pc_clock": "the cell's time agrees with this PC's clock again",
    "settings_refused": "the settings file is in force again",
    "recorder": "recording works again",
    "record_displaced": "recording continues in a new file",
    "record_short": "no recording was removed early in the last hour",
    "door_tried": "no more series of failed logins at {part}",
    "door_flooded": "no more floods of connections at {part}",
}
"""Kinds of alarms about the daemon itself, and what the statement of their clears says."""
SECTIONS: Final = {
    **dict.fromkeys(("source", "clock", "accounting"), "sources"),
    **dict.fromkeys(("sink", "door"), "sinks"),
    "stage": "stages",
}
"""Sections of the health in which the part of an alarm is listed, by the first word of its kind."""
REASONED: Final = frozenset(("source_down", "sink_down", "recorder", "settings_refused"))
"""Kinds whose statement is a reason; the statement of an active alarm follows it, at most every ``RENEW_EVERY`` s."""
RENEW_EVERY: Final = 60.0
TASKS: Final = {"collect": "the devices", "align": "the frames", "tell": "the record and the outlets"}
"""Tasks of the processes by name; the others are named after the stages that they run, ``judge faults``."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """A condition of the daemon that calls for an alarm."""

    kind: str
    severity: Severity
    part: str
    statement: str
    evidence: Mapping[str, Any]

    def alarm(self, now: int) -> Alarm:
        """The alarm for this condition, raised at ``now`` ns."""
        source = self.part if self.kind.startswith(("source_", "clock_", "accounting")) else None
        name, text = f"{self.kind}:{self.part}", self.statement
        return Alarm(name, self.kind, self.severity, True, now, now, text, source=source, evidence=self.evidence)


def troubles(
    status: Mapping[str, Any], before: Mapping[str, Any], seconds: float, waited: Mapping[str, float]
) -> list[Trouble]:
    """Find what is wrong by comparing the health figures with those of ``seconds`` ago.

    ``waited``: s for which processes waited for a processor in that time, by process name.
    """
    found: list[Trouble] = []
    for name, source in status["sources"].items():
        if source["state"] == "ok" and name in before["sources"]:
            found += _slow(name, source, before["sources"][name], seconds)
            found += _unsure(name, source)
        found += _silent(name, source)
        if name in before["sources"]:
            found += _strange(name, source, before["sources"][name], seconds)
            found += _unsteady(name, source, before["sources"][name], seconds)
        if source["state"] == "retrying":
            text = f"Source {name} is down: {source['error']}"
            found.append(Trouble("source_down", "error", name, text, {"down_s": source["since_s"]}))
        if source["residue"]:
            text = f"Source {name}: {source['residue']} samples are not accounted for."
            figures = {k: source[k] for k in ("expected", "received", "missed", "dropped")}
            found.append(Trouble("accounting", "warning", name, text, figures))
    for name, stage in status["stages"].items():
        if stage["state"] != "ok":
            found.append(Trouble("stage_broken", "error", name, f"Stage {name} failed: {stage['error']}", {}))
        dropped = stage.get("dropped", 0) - before["stages"].get(name, {}).get("dropped", 0)
        if dropped > 0:
            text = f"Stage {name} is too slow: {dropped} of its frames were dropped in the last {SPAN:.0f} s."
            found.append(Trouble("stage_slow", "warning", name, text, {"dropped_frames": dropped}))
    for name, outlet in status["sinks"].items():
        if outlet["state"] == "down":
            found.append(Trouble("sink_down", "warning", name, f"Outlet {name} is down: {outlet['error']}", {}))
        found += _attacked(name, outlet, before["sinks"].get(name, outlet))
    for name, process in status.get("processes", {}).items():
        if process["down"]:
            text = f"The process for {_task(name)} has not responded for {process['silent_s']:.0f} s. Other processes"
            found.append(
                Trouble("process_down", "error", name, text + " are running.", {"restarts": process["restarts"]})
            )
        found += _behind(name, process, before.get("processes", {}).get(name, {}))
    found = _by_cause(found, waited)
    if abs(apart := 1e-3 * status.get("utc_error_ms", 0.0)) > APART:
        text = (
            f"The cell's time is {abs(apart):.1f} s {'ahead of' if apart > 0 else 'behind'} this PC's clock, which was "
            "set. The difference shrinks by 1.8 s an hour. If the clock is right now, restart the daemon."
        )
        found.append(Trouble("pc_clock", "warning", "cell", text, {"apart_s": round(apart, 3)}))
    if refused := status.get("refused_settings"):
        text = f"The changed settings file is not in force: {refused}. The old settings remain active."
        found.append(Trouble("settings_refused", "warning", "cell", text, {}))
    recorder = status.get("recorder")
    return found if recorder is None else [*found, *_recording(recorder, before.get("recorder") or {})]


def _recording(recorder: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[Trouble]:
    if recorder["state"] != "ok":
        text = f"Samples cannot be recorded, {recorder['state']}: {recorder.get('problem', '')}".rstrip(": ")
        yield Trouble("recorder", "error", "recorder", text, {"refused": dict(recorder.get("drops", {}))})
    displaced, earlier = recorder.get("displaced", {}), before.get("displaced", {})
    moved = displaced.get("files", 0) > earlier.get("files", 0)
    lost = {} if moved else _more(recorder["drops"], before.get("drops", {}))
    if recorder["state"] == "ok" and (lost or recorder["overdue"] > SPAN):  # a disk that hangs reports no error
        what = f"{sum(lost.values())} messages were not recorded in the last {SPAN:.0f} s"
        text = what if lost else f"nothing was written for {recorder['overdue']:.0f} s"
        text = f"Recording is disturbed: {text}. The disk is too slow or does not respond, or the log says why."
        yield Trouble("recorder", "error", "recorder", text, {"refused": lost})
    if moved:
        text = f"{displaced['reason']}; recording continues in a new file."
        yield Trouble("record_displaced", "error", "recorder", text, {"lacking": displaced["messages"]})
    if short := recorder.get("short"):
        text = (
            f"The disk was full: {short['files']} recordings were removed to make room. {short['bytes'] / 1e9:.2f} GB "
            f"of recordings remain; the setting keep allows {short['keep'] / 1e9:.2f} GB. Other files fill the disk."
        )
        yield Trouble("record_short", "warning", "recorder", text, dict(short))


def _attacked(name: str, outlet: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[Trouble]:
    """Find failed logins at an outlet, by password or token, and floods of connections."""
    counted, earlier = outlet.get("counters", {}), before.get("counters", {})
    flood = _more({what: counted.get(what, 0) for what in TURNED_AWAY}, earlier)
    if sum(flood.values()) >= FLOOD:
        text = (
            f"Too many connections to outlet {name}: {_listed(flood)} in the last {SPAN:.0f} s. It may respond slowly."
        )
        yield Trouble("door_flooded", "warning", name, text, flood)
    tries = _more({what: counted.get(what, 0) for what in (FAILED, REFUSED)}, earlier)
    if sum(tries.values()) >= FEWEST_STRANGE:
        text = f"Outlet {name}: {_listed(tries)} in the last {SPAN:.0f} s. The log names the addresses they came from."
        yield Trouble("door_tried", "warning", name, text, tries)


def _by_cause(found: list[Trouble], waited: Mapping[str, float]) -> list[Trouble]:
    """Replace what a PC that is too busy causes in devices and stages by a single alarm about the PC."""
    suffer = [trouble for trouble in found if _suffers(trouble, bool(waited))]
    if not suffer and not waited:
        return found
    text = "This PC is too slow for the programs that run on it"
    if waited:
        waits = ", ".join(f"{name} for {silent:.0f} s" for name, silent in waited.items())
        text = f"{text}. Processes that waited for a processor: {waits}"
    if suffer:
        affected = ", ".join(f"{trouble.kind.partition('_')[0]} {trouble.part}" for trouble in suffer)
        text = f"{text}. Affected: {affected}"
    evidence = {"waiting_s": dict(waited), "affected": [trouble.statement for trouble in suffer]}
    return [*(t for t in found if t not in suffer), Trouble("pc_slow", "warning", "pc", f"{text}.", evidence)]


def _suffers(trouble: Trouble, starved: bool) -> bool:
    if trouble.kind == "source_slow":
        lost = trouble.evidence["lost"]
        return starved or 2 * lost.get(HOST, 0) > sum(lost.values())
    return starved and trouble.kind == "stage_slow"


def _behind(name: str, process: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[Trouble]:
    """Find a process that fell behind by more than the ring holds, so that it lost data."""
    lost = process.get("skipped_bytes", 0) - before.get("skipped_bytes", 0)
    if lost > 0:
        what = "are missing in the record" if name == "tell" else "were skipped"
        text = f"The process for {_task(name)} fell more than 10 s behind: {lost} bytes of samples {what}. This PC is"
        yield Trouble("process_slow", "error", name, f"{text} busy with other programs.", {"skipped_bytes": lost})


def _task(process: str) -> str:
    return TASKS.get(process, process.replace("judge ", "stage ", 1))


def _silent(name: str, source: Mapping[str, Any]) -> Iterator[Trouble]:
    """Find a device that answers but sends no values, or none for some of its channels."""
    since = source["since_s"]
    if source["state"] == "starting" and since >= (SPAN if source["identity"] else HANGS):
        so_far = "answers, but has sent no values" if source["identity"] else "has neither connected nor failed"
        text = f"Source {name} {so_far} for {since:.0f} s. For details run cellwatt doctor."
        yield Trouble("source_silent", "error", name, text, {"silent_s": since})
    blank = [
        f"{name}.{channel}"
        for figures in source["streams"].values()
        if source["state"] == "ok" and since >= max(SPAN, PERIODS / (figures["nominal_hz"] or math.inf))
        for channel in figures.get("blank", ())
        if figures["samples"] or figures["nominal_hz"]  # a stream that is sent on change may never have changed
    ]
    if blank:
        more = f" and {len(blank) - MOST_NAMED} more" if len(blank) > MOST_NAMED else ""
        text = f"Source {name} answers, but sends no values for {', '.join(blank[:MOST_NAMED])}{more}"
        hint = "Check that the device has these channels and that their sensors work."
        yield Trouble("source_blank", "warning", name, f"{text}. {hint}", {"channels": blank})


def _slow(name: str, source: Mapping[str, Any], before: Mapping[str, Any], seconds: float) -> list[Trouble]:
    """Find the slowest stream below its declared rate, and the reasons that its source counted."""
    if source["since_s"] < seconds:
        return []  # the source has not run that long
    least, text, rates = LEAST, "", {}
    for stream, figures in source["streams"].items():
        given = figures["samples"] - before["streams"].get(stream, figures)["samples"]
        due = (figures["nominal_hz"] or 0.0) * seconds
        if due < FEWEST or given < 0 or given / due >= least:
            continue
        least, rates = given / due, {"rate_hz": round(given / seconds, 2), "nominal_hz": figures["nominal_hz"]}
        text = f"Source {name} delivers {given / seconds:.3g} of {figures['nominal_hz']:g} samples a second ({stream})"
    if not text:
        return []
    reasons = _more(source["missed"], before["missed"]) | _more(source["dropped"], before["dropped"])
    lost = f"lost: {_listed(reasons)}" if reasons else "the device sends no more"
    return [Trouble("source_slow", "warning", name, f"{text}; {lost}.", {**rates, "lost": reasons})]


def _strange(name: str, source: Mapping[str, Any], before: Mapping[str, Any], seconds: float) -> list[Trouble]:
    """Find received data that are not samples of this device, as its driver counts them."""
    counted, earlier = source["counters"], before["counters"]
    odd = _more({what: counted[what] for what in source["anomalies"]}, earlier)
    odd |= _more(source["dropped"], before["dropped"])
    forged = _more({what: counted[what] for what in source["forgeries"]}, earlier)
    due = source["expected"] - before["expected"]
    if not forged and sum(odd.values()) <= max(FEWEST_STRANGE, STRANGE * due):
        return []
    who = (
        "Another sender uses the device's name" if forged else "The line or the device is faulty, or is being disturbed"
    )
    text = f"Source {name}: {_listed(forged | odd)} in the last {seconds:.0f} s. {who}."
    return [Trouble("source_strange", "warning", name, text, forged | odd)]


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {what}" for what, n in counts.items())


def _more(counted: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    """Growth of each count that grew."""
    return {what: more for what, n in counted.items() if (more := n - before.get(what, 0)) > 0}


def _unsteady(name: str, source: Mapping[str, Any], before: Mapping[str, Any], seconds: float) -> list[Trouble]:
    """Find a device's clock that is set repeatedly or runs backwards."""
    for stream, clock in source["clocks"].items():
        resets = clock["resets"] - before["clocks"].get(stream, clock)["resets"]
        if resets >= RESETS:
            text = f"The clock of source {name} is unsteady, {resets} resets in the last {seconds:.0f} s"
            return [Trouble("clock_unsteady", "warning", name, f"{text}: {clock['reason']}.", {"resets": resets})]
    return []


def _unsure(name: str, source: Mapping[str, Any]) -> Iterator[Trouble]:
    """Find a device's clock that is not known accurately enough for frames."""
    worst = max((clock["bound_ns"] * 1e-9 for clock in source["clocks"].values()), default=0.0)
    if source["since_s"] >= SPAN and worst > UNSURE:
        text = f"Time stamps of source {name} may be wrong by up to {worst:.2g} s: its samples arrive too irregularly."
        yield Trouble("clock_unsure", "warning", name, text, {"bound_s": round(worst, 3)})


class Monitor:
    """Turns the conditions that ``troubles`` finds at each check into alarms.

    ``active`` are the alarms that a previous monitor left active; those of kinds outside ``KINDS`` are ignored.
    """

    def __init__(self, active: Iterable[Alarm] = ()) -> None:
        self.troubles: list[Trouble] = []
        """Conditions found at the last check, whether or not their alarms are raised yet."""
        self._past: deque[tuple[int, Mapping[str, Any]]] = deque()
        self._book = AlarmBook()
        for alarm in active:
            if alarm.stage is None and alarm.kind in KINDS:
                self._book.take(alarm)

    def look(self, status: Mapping[str, Any], now: int) -> list[Alarm]:
        """Check the health figures at ``now``, UTC ns; return the alarms raised or cleared."""
        self._past.append((now, status))
        while len(self._past) > 2 and (now - self._past[1][0]) * 1e-9 >= SPAN:
            self._past.popleft()
        then, before = self._past[0]
        self.troubles = troubles(status, before, (now - then) * 1e-9, self._waited())
        found = {alarm.id: alarm for alarm in (trouble.alarm(now) for trouble in self.troubles)}
        alarms = [
            a for alarm in found.values() for a in self._book.raise_(alarm, after=AGREED, update=self._outdated(alarm))
        ]
        for name in self._book:
            if name not in found:
                kind, _, part = name.partition(":")
                text = f"Resolved: {KINDS[kind].format(part=_task(part) if kind.startswith('process_') else part)}."
                section = SECTIONS.get(kind.partition("_")[0])
                if section is not None and part not in status[section]:
                    text = f"Withdrawn, as {part} is no longer part of the cell: {self._book[name].alarm.statement}"
                after = STEADY if kind == "source_down" else AGREED
                alarms += self._book.clear(name, now, text, after=after)
        return alarms

    def _outdated(self, alarm: Alarm) -> bool:
        """True if an active alarm has stated another reason for at least a minute."""
        if alarm.kind not in REASONED or alarm.id not in self._book:
            return False
        before = self._book[alarm.id].alarm
        return before.statement != alarm.statement and alarm.time - before.time >= RENEW_EVERY * 1e9

    def _waited(self) -> dict[str, float]:
        """Longest times, s, for which processes waited for a processor within ``SPAN``."""
        found: dict[str, float] = {}
        for _, status in self._past:
            for name, process in status.get("processes", {}).items():
                if process.get("starved"):
                    found[name] = max(process["silent_s"], found.get(name, 0.0))
        return found
