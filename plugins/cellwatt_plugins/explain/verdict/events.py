"""One event gives one finding: a push that several joints feel, or the push of a gripper that takes or releases a
part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cellwatt_plugins.explain.verdict.findings import Finding, Span, Where

TOGETHER = 0.4
"""s within which pushes on several joints are one push on the arm."""
EDGE = 1.0
"""s around the start or end of a payload within which the gripper pushes as well."""


def merged(findings: Sequence[Finding]) -> list[Finding]:
    """The findings with each event once: a push is listed at the joint that shows it best, and not at a payload's start
    or end."""
    pushes = [f for f in findings if f.effect == "external_contact"]
    edges = [s for f in findings if f.effect == "payload_change" for s in f.where.times]
    ordered = sorted((p for p in pushes if not _at_edge(p, edges)), key=_size, reverse=True)
    events: list[Finding] = []
    for push in ordered:
        same = next((i for i, other in enumerate(events) if _together(push, other)), None)
        if same is None:
            events.append(push)
        else:
            events[same] = _joined(events[same], push)
    # Keep the order in which the findings were found.
    places = {f.joint: f for f in events}
    return [places.get(f.joint, f) if f in pushes else f for f in findings if f not in pushes or f.joint in places]


def _size(push: Finding) -> float:
    return (push.improvement.before - push.improvement.after) / push.improvement.noise_floor


def _at_edge(push: Finding, edges: Sequence[Span]) -> bool:
    moments = [(span.recording, moment) for span in edges for moment in (span.start, span.end)]
    return any(
        span.recording == recording and span.start - EDGE < moment < span.end + EDGE
        for span in push.where.times
        for recording, moment in moments
    )


def _together(one: Finding, other: Finding) -> bool:
    return any(
        a.recording == b.recording and a.start - TOGETHER < b.end and b.start - TOGETHER < a.end
        for a in one.where.times
        for b in other.where.times
    )


def _joined(main: Finding, more: Finding) -> Finding:
    """The push, with another joint that felt it added."""
    torque = more.parameters["torque"]
    unit = torque.unit.replace("N*m", "Nm")
    where = main.where
    channels = tuple(dict.fromkeys((*where.channels, *more.where.channels)))
    statement = (
        f"{main.statement.rstrip('.')}; joint {more.joint} felt {torque.value:.2g} ± {torque.std:.1g} {unit} of it."
    )
    return replace(main, statement=statement, where=Where(channels, where.position, where.velocity, where.times))
