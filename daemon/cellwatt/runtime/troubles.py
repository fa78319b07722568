"""Troubles of the daemon itself, and their alarms: a source is down or slow, samples do not add up, …"""

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
"""Looks in a row, about one a second, that must agree before an alarm is raised or cleared."""
AGREED: Final = Patience(PATIENCE)
STEADY: Final = Patience(PATIENCE, 15.0)
"""For how long a source must be back before its alarm is cleared: one that comes and goes is one alarm."""
SPAN: Final = 10.0
"""s over which it is looked at what a source gives and a stage takes."""
FEWEST: Final = 10
"""Samples due, from which a stream's rate is judged."""
LEAST: Final = 0.9
"""Share of the samples due that a stream must give."""
STRANGE: Final = 0.01
"""Share of the samples due that may be doubled, malformed, late …"""
FEWEST_STRANGE: Final = 5
"""… or so many, where that is more."""
FLOOD: Final = 50
"""Connections within ``SPAN`` that a door turned away or cut off: more than browsers that lost their network."""
PERIODS: Final = 3
"""Periods of a slow stream without a sample, after which it counts as one that gives none."""
MOST_NAMED: Final = 5
"""Channels that an alarm names."""
RESETS: Final = 3
"""Resets of a device's clock within ``SPAN`` that are one clock which cannot be followed."""
APART: Final = 1.0
"""s by which the cell's time may differ from the PC's clock: that one was set, and the cell's time follows slowly."""
UNSURE: Final = 0.05
"""s by which samples of a device with a clock may be off in time, at most: frames come every 20 ms."""


KINDS: Final = {
    "source_down": "source {part} is back",
    "source_silent": "source {part} gives numbers",
    "source_blank": "source {part} gives a number for each of its channels",
    "source_slow": "source {part} gives its declared rate again",
    "source_strange": "source {part} sends nothing strange any more",
    "clock_unsure": "source {part}: its clock is known well enough again",
    "clock_unsteady": "source {part}: its clock can be followed again",
    "accounting": "source {part}: all samples are accounted for",
    "stage_broken": "stage {part} runs again",
    "stage_slow": "stage {part} keeps up again",
    "sink_down": "outlet {part} is back",
    "process_down": "process {part} is back",
    "process_slow": "process {part} keeps up again",
    "pc_slow": "all processes run again",
    "pc_clock": "the cell's time is the PC's again",
    "recorder": "recording works again",
    "record_displaced": "recording goes on in a new file",
    "record_short": "no recordings had to go before their time in the last hour",
    "door_tried": "nobody tries passwords at {part} any more",
    "door_flooded": "nobody fills {part} with connections any more",
}
"""Alarms about the daemon itself, and what is said when they end."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One thing that is wrong with the daemon now."""

    kind: str
    severity: Severity
    part: str
    statement: str
    evidence: Mapping[str, Any]

    def alarm(self, now: int) -> Alarm:
        """The alarm about it, raised at ``now`` ns."""
        source = self.part if self.kind.startswith(("source_", "clock_", "accounting")) else None
        name, said = f"{self.kind}:{self.part}", self.statement
        return Alarm(name, self.kind, self.severity, True, now, now, said, source=source, evidence=self.evidence)


def troubles(
    status: Mapping[str, Any], before: Mapping[str, Any], seconds: float, waited: Mapping[str, float]
) -> list[Trouble]:
    """Find what is wrong by the health figures and those of ``seconds`` ago.

    ``waited``: s that processes waited for a processor in that time, by name.
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
            found.append(Trouble("stage_broken", "error", name, f"Stage {name} broke: {stage['error']}", {}))
        dropped = stage.get("dropped", 0) - before["stages"].get(name, {}).get("dropped", 0)
        if dropped > 0:
            text = f"Stage {name} is too slow: {dropped} frames were dropped in front of it in the last {SPAN:.0f} s."
            found.append(Trouble("stage_slow", "warning", name, text, {"dropped_frames": dropped}))
    for name, outlet in status["sinks"].items():
        if outlet["state"] == "down":
            found.append(Trouble("sink_down", "warning", name, f"Outlet {name} is down: {outlet['error']}", {}))
        found += _attacked(name, outlet, before["sinks"].get(name, outlet))
    for name, process in status.get("processes", {}).items():
        if process["down"]:
            text = f"Process {name} has not been heard of for {process['silent_s']:.0f} s; the others go on."
            found.append(Trouble("process_down", "error", name, text, {"restarts": process["restarts"]}))
        found += _behind(name, process, before.get("processes", {}).get(name, {}))
    found = _by_cause(found, waited)
    if abs(apart := 1e-3 * status.get("utc_error_ms", 0.0)) > APART:
        text = (
            f"The cell's time is {abs(apart):.1f} s {'ahead of' if apart > 0 else 'behind'} this PC's clock, which was "
            "set: it follows by 1.8 s an hour. Restart the daemon if the clock is right now."
        )
        found.append(Trouble("pc_clock", "warning", "cell", text, {"apart_s": round(apart, 3)}))
    recorder = status.get("recorder")
    return found if recorder is None else [*found, *_recording(recorder, before.get("recorder") or {})]


def _recording(recorder: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[Trouble]:
    if recorder["state"] != "ok":
        text = f"Recording is disturbed: {recorder['state']} {recorder.get('problem', '')}".rstrip()
        yield Trouble("recorder", "error", "recorder", text, {"refused": dict(recorder.get("drops", {}))})
    displaced, earlier = recorder.get("displaced", {}), before.get("displaced", {})
    if displaced.get("files", 0) > earlier.get("files", 0):
        text = f"{displaced['reason']}; recording goes on in a new file."
        yield Trouble("record_displaced", "error", "recorder", text, {"lacking": displaced["messages"]})
    if short := recorder.get("short"):
        text = (
            f"The disk was full: {short['files']} recordings were removed to make room, {short['bytes'] / 1e9:.2f} GB "
            f"are left of the {short['keep'] / 1e9:.2f} GB that keep asks for. Something else fills the disk."
        )
        yield Trouble("record_short", "warning", "recorder", text, dict(short))


def _attacked(name: str, outlet: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[Trouble]:
    """Somebody who tries passwords or tokens at a door, or fills it with connections."""
    counted, earlier = outlet.get("counters", {}), before.get("counters", {})
    flood = _more({what: counted.get(what, 0) for what in TURNED_AWAY}, earlier)
    if sum(flood.values()) >= FLOOD:
        told = ", ".join(f"{n} {what}" for what, n in flood.items())
        text = f"Somebody fills {name} with connections: {told} in the last {SPAN:.0f} s; others may find it slow."
        yield Trouble("door_flooded", "warning", name, text, flood)
    tries = _more({what: counted.get(what, 0) for what in (FAILED, REFUSED)}, earlier)
    if sum(tries.values()) >= FEWEST_STRANGE:
        told = ", ".join(f"{n} {what}" for what, n in tries.items())
        text = f"Somebody tries passwords at {name}: {told} in the last {SPAN:.0f} s; the log says from where."
        yield Trouble("door_tried", "warning", name, text, tries)


def _by_cause(found: list[Trouble], waited: Mapping[str, float]) -> list[Trouble]:
    """What comes of a PC that is too busy is one trouble, and none of the devices and stages that suffer from it."""
    suffer = [trouble for trouble in found if _suffers(trouble, bool(waited))]
    if not suffer and not waited:
        return found
    text = "This PC is too slow for all that runs on it"
    if waited:
        told = ", ".join(f"{name} for {silent:.0f} s" for name, silent in waited.items())
        text = f"{text}; these have waited for a processor: {told}"
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
    """A process that fell behind by more than the ring holds, so that it never saw some of it."""
    lost = process.get("skipped_bytes", 0) - before.get("skipped_bytes", 0)
    if lost > 0:
        what = "are missing in the record" if name == "tell" else "were left out"
        text = f"Process {name} fell more than 10 s behind: {lost} bytes of samples {what}. This PC is too busy"
        yield Trouble("process_slow", "error", name, f"{text} with other programs.", {"skipped_bytes": lost})


def _silent(name: str, source: Mapping[str, Any]) -> Iterator[Trouble]:
    """A device that answers and gives no number, or none for some of its channels."""
    since = source["since_s"]
    if source["state"] == "starting" and source["identity"] and since >= SPAN:
        text = f"Source {name} answers, but has given no number since, for {since:.0f} s: cellwatt doctor tells more."
        yield Trouble("source_silent", "error", name, text, {"silent_s": since})
    blank = [
        f"{name}.{channel}"
        for figures in source["streams"].values()
        if source["state"] == "ok" and since >= max(SPAN, PERIODS / (figures["nominal_hz"] or math.inf))
        for channel in figures.get("blank", ())
        if figures["samples"] or figures["nominal_hz"]  # what is sent on change may never have changed
    ]
    if blank:
        more = f" and {len(blank) - MOST_NAMED} more" if len(blank) > MOST_NAMED else ""
        text = f"Source {name} answers, but gives no number for {', '.join(blank[:MOST_NAMED])}{more}"
        hint = "has the device such channels, and are their sensors alive?"
        yield Trouble("source_blank", "warning", name, f"{text}: {hint}", {"channels": blank})


def _slow(name: str, source: Mapping[str, Any], before: Mapping[str, Any], seconds: float) -> list[Trouble]:
    """A stream that gave less than it declares, and what its source says of the rest."""
    if source["since_s"] < seconds:
        return []  # it has been up for less
    least, text, rates = LEAST, "", {}
    for stream, figures in source["streams"].items():
        given = figures["samples"] - before["streams"].get(stream, figures)["samples"]
        due = (figures["nominal_hz"] or 0.0) * seconds
        if due < FEWEST or given < 0 or given / due >= least:
            continue
        least, rates = given / due, {"rate_hz": round(given / seconds, 2), "nominal_hz": figures["nominal_hz"]}
        text = f"Source {name} gives {given / seconds:.3g} of {figures['nominal_hz']:g} samples a second ({stream})"
    if not text:
        return []
    reasons = _more(source["missed"], before["missed"]) | _more(source["dropped"], before["dropped"])
    told = ", ".join(f"{n} by {why}" for why, n in reasons.items()) or "it sends no more"
    return [Trouble("source_slow", "warning", name, f"{text}: {told}.", {**rates, "lost": reasons})]


def _strange(name: str, source: Mapping[str, Any], before: Mapping[str, Any], seconds: float) -> list[Trouble]:
    """Find what came that is no sample, or none of this device's; its driver says what counts as that."""
    counted, earlier = source["counters"], before["counters"]
    odd = _more({what: counted[what] for what in source["anomalies"]}, earlier)
    odd |= _more(source["dropped"], before["dropped"])
    forged = _more({what: counted[what] for what in source["forgeries"]}, earlier)
    due = source["expected"] - before["expected"]
    if not forged and sum(odd.values()) <= max(FEWEST_STRANGE, STRANGE * due):
        return []
    told = ", ".join(f"{n} {what}" for what, n in (forged | odd).items())
    who = (
        "somebody else speaks in its name" if forged else "the line or the device is disturbed, or somebody disturbs it"
    )
    text = f"Source {name}, last {seconds:.0f} s: {told}: {who}."
    return [Trouble("source_strange", "warning", name, text, forged | odd)]


def _more(counted: Mapping[str, int], before: Mapping[str, int]) -> dict[str, int]:
    """By how much each count grew, where it did."""
    return {what: more for what, n in counted.items() if (more := n - before.get(what, 0)) > 0}


def _unsteady(name: str, source: Mapping[str, Any], before: Mapping[str, Any], seconds: float) -> list[Trouble]:
    """A device's clock that is set again and again, or runs backwards."""
    for stream, clock in source["clocks"].items():
        resets = clock["resets"] - before["clocks"].get(stream, clock)["resets"]
        if resets >= RESETS:
            text = f"Source {name}: its clock cannot be followed, {resets} resets in the last {seconds:.0f} s"
            return [Trouble("clock_unsteady", "warning", name, f"{text}: {clock['reason']}.", {"resets": resets})]
    return []


def _unsure(name: str, source: Mapping[str, Any]) -> Iterator[Trouble]:
    """A device's clock that is not followed well enough for frames."""
    worst = max((clock["bound_ns"] * 1e-9 for clock in source["clocks"].values()), default=0.0)
    if source["since_s"] >= SPAN and worst > UNSURE:
        text = f"Source {name}: samples may be off by up to {worst:.2g} s, as nothing comes in time to tell its clock."
        yield Trouble("clock_unsure", "warning", name, text, {"bound_s": round(worst, 3)})


class Monitor:
    """Turns what ``troubles`` finds, look by look, into alarms.

    ``active`` are the alarms that another watch has left active; those of other kinds are not ours to clear.
    """

    def __init__(self, active: Iterable[Alarm] = ()) -> None:
        self.troubles: list[Trouble] = []
        """Findings of the last look, alarm or not yet."""
        self._past: deque[tuple[int, Mapping[str, Any]]] = deque()
        self._book = AlarmBook()
        for alarm in active:
            if alarm.stage is None and alarm.kind in KINDS:
                self._book.take(alarm)

    def look(self, status: Mapping[str, Any], now: int) -> list[Alarm]:
        """Alarms raised or cleared by this look; ``now`` ns UTC."""
        self._past.append((now, status))
        while len(self._past) > 2 and (now - self._past[1][0]) * 1e-9 >= SPAN:
            self._past.popleft()
        then, before = self._past[0]
        self.troubles = troubles(status, before, (now - then) * 1e-9, self._waited())
        found = {alarm.id: alarm for alarm in (trouble.alarm(now) for trouble in self.troubles)}
        said = [a for alarm in found.values() for a in self._book.raise_(alarm, after=AGREED, update=False)]
        for name in self._book:
            if name not in found:
                kind, _, part = name.partition(":")
                after = STEADY if kind == "source_down" else AGREED
                said += self._book.clear(name, now, f"Resolved: {KINDS[kind].format(part=part)}.", after=after)
        return said

    def _waited(self) -> dict[str, float]:
        """Longest times, s, for which processes waited for a processor within ``SPAN``."""
        found: dict[str, float] = {}
        for _, status in self._past:
            for name, process in status.get("processes", {}).items():
                if process.get("starved"):
                    found[name] = max(process["silent_s"], found.get(name, 0.0))
        return found
