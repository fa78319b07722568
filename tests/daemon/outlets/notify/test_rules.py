"""The rules and what is told, as a machine over given alarms and times."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt import Alarm
from cellwatt.outlets.notify.rules import AGAIN, Item, Notification, Recipient, Rules, message_of, ready, silence
from tests.daemon.outlets.notify.cell import EPOCH, SECOND, alarm

NEXT = EPOCH + 3600 * SECOND
"""The session after."""


class Machine:
    """One recipient; ``sent`` are the items of messages that were accepted, in order."""

    def __init__(self, rules: Rules | None = None, **more: Any) -> None:
        self.rules = rules or Rules(**{"severity": "info", **more})
        self.told = Recipient()
        self.line = json.dumps(self.told.saved())
        self.sent: list[Item] = []
        self.passing = 0
        self.session = EPOCH

    def keep(self) -> None:
        """Write down what is known, where there is something new."""
        if self.told.changed:
            self.line, self.told.changed = json.dumps(self.told.saved()), False

    def take(self, *alarms: Alarm) -> None:
        for one in alarms:
            self.rules.take(self.told, one, self.session, self.passing)
            self.keep()

    def send(self, now: int = EPOCH) -> Notification | None:
        if self.told.flight is None and (items := ready(self.told, self.passing)):
            self.told.send(message_of("test", items, self.told.more, now))
        sent = self.told.flight
        if sent is not None:
            self.sent += sent.items
            self.told.arrived()
        self.keep()
        return sent

    def again(self, session: int = EPOCH) -> None:
        """Begin again from what is on disk."""
        self.keep()
        self.told, self.session = Recipient.read(json.loads(self.line)), session

    @property
    def said(self) -> list[tuple[str, int | None]]:
        return [(item.what, item.alarm.joint) for item in self.sent]


def test_only_kinds_and_severities_that_are_wanted() -> None:
    machine = Machine(severity="warning", kinds=("joint_*", "source_down"))
    machine.take(alarm(1, severity="info"), alarm(2, severity="warning"), alarm(3, kind="energy_balance"))
    machine.take(alarm(4, kind="source_down"), alarm(1, severity="info", active=False))
    machine.send()
    assert machine.said == [("raised", 2), ("raised", 4)]


def test_what_becomes_graver_is_told_again_and_what_becomes_less_grave_is_not() -> None:
    machine = Machine(severity="warning")
    for severity in ("info", "warning", "warning", "error", "warning", "error"):
        machine.take(alarm(1, severity=severity))
        machine.send()
    assert machine.said == [("raised", 1), ("graver", 1)]


def test_a_clear_is_not_told_where_it_is_not_wanted_or_the_raise_was_not() -> None:
    machine = Machine(resolved=False)
    machine.take(alarm(1))
    machine.send()
    machine.take(alarm(1, active=False), alarm(2, active=False))
    assert machine.send() is None
    machine.take(alarm(1, time=EPOCH + 2 * SECOND))  # raised anew
    machine.send()
    assert machine.said == [("raised", 1), ("raised", 1)]


def test_a_quiet_time_holds_back_and_tells_what_is_still_active() -> None:
    machine = Machine()
    machine.take(alarm(9, severity="warning"))
    machine.send()
    machine.passing = 2
    machine.take(*(alarm(n, severity="warning") for n in (1, 2)), alarm(3))
    machine.send()
    assert machine.said[1:] == [("raised", 3)]
    machine.take(alarm(1, severity="warning", active=False), alarm(9, severity="warning", active=False))
    assert machine.send() is None
    machine.passing = 0
    machine.send()
    assert set(machine.said[2:]) == {("raised", 2), ("cleared", 9)}


def test_raised_again_soon_after_the_daemon_began_anew_it_is_the_same() -> None:
    machine = Machine()
    machine.take(alarm(1), alarm(2))
    machine.send()
    machine.again(NEXT)
    machine.take(alarm(1, since=NEXT, time=NEXT + SECOND))
    machine.rules.withdraw(machine.told, NEXT, NEXT + AGAIN - 1)
    assert machine.send() is None
    machine.rules.withdraw(machine.told, NEXT, NEXT + AGAIN)
    machine.send()
    assert machine.sent[2].alarm.statement.startswith("Not raised again since the daemon restarted: Joint 2")
    machine.rules.withdraw(machine.told, NEXT, NEXT + 2 * AGAIN)
    machine.take(alarm(1, active=False, time=NEXT + 2 * AGAIN))
    machine.send()
    assert machine.said[2:] == [("cleared", 2), ("cleared", 1)]


def test_without_room_the_least_grave_is_only_counted() -> None:
    machine = Machine(queue=3)
    severities = ("info", "error", "warning", "info", "error", "error")
    machine.take(*(alarm(n, severity=severity) for n, severity in enumerate(severities)))
    sent = machine.send()
    assert sent is not None
    assert [item.alarm.joint for item in sent.items] == [1, 4, 5]
    assert sent.more == 3
    machine.take(alarm(0, severity="info", active=False), alarm(1, active=False))
    machine.take(alarm(3, severity="info", time=EPOCH + 50))  # counted before, and not new
    machine.send()
    assert machine.said[3:] == [("cleared", 1)]


def test_what_was_left_out_and_then_becomes_graver_is_raised() -> None:
    machine = Machine(severity="info", queue=1)
    machine.take(alarm(1, severity="warning"), alarm(2, severity="info"), alarm(2, severity="error"))
    machine.send()
    machine.take(alarm(2, active=False))
    machine.send()
    assert machine.said == [("raised", 2), ("cleared", 2)]


STEPS = st.one_of(
    st.tuples(st.just("raise"), st.integers(1, 4), st.sampled_from(["info", "warning", "error"])),
    st.tuples(st.just("clear"), st.integers(1, 4), st.just("error")),
    st.tuples(st.sampled_from(["quiet", "loud", "make", "send", "shelve", "crash", "look"]), st.integers(1, 4)),
)


def play(machine: Machine, steps: list[Any]) -> dict[int, bool]:
    """Do all steps, checking what holds after each; return which alarms that were ever raised are up at the end."""
    up: dict[int, bool] = {}
    time = EPOCH
    for step in steps:
        time += SECOND
        number = step[1]
        match step[0]:
            case "raise":
                up[number] = True
                machine.take(alarm(number, severity=step[2], time=time))
            case "clear":
                up[number] = False
                machine.take(alarm(number, active=False, time=time))
            case "quiet" | "loud":
                machine.passing = 2 if step[0] == "quiet" else 0
            case "shelve":
                silence(machine.told, alarm(number).id)
            case "make":
                if machine.told.flight is None and (items := ready(machine.told, machine.passing)):
                    machine.told.send(message_of("test", items, machine.told.more, time))
            case "send":
                machine.send(time)
            case "look":
                machine.rules.withdraw(machine.told, EPOCH, time)
            case "crash":
                before = machine.told.flight, machine.told.due.keys(), machine.told.more
                machine.again()
                assert (machine.told.flight, machine.told.due.keys(), machine.told.more) == before
        assert len(machine.told.due) <= machine.rules.queue
    return up


@settings(max_examples=150)
@given(st.lists(STEPS, max_size=40), st.integers(1, 5))
def test_whatever_happens_a_clear_follows_its_raise(steps: list[Any], queue: int) -> None:
    machine = Machine(queue=queue)
    up = play(machine, steps)
    for number in up:
        said = [what for what, joint in machine.said if joint == number and what != "graver"]
        assert said[:1] in ([], ["raised"])
        assert all(pair != ("cleared", "cleared") for pair in pairwise(said))


@settings(max_examples=150)
@given(st.lists(STEPS.filter(lambda step: step[0] != "shelve"), max_size=40))
def test_in_the_end_everybody_knows_what_is_up_and_nothing_is_said_twice(steps: list[Any]) -> None:
    machine = Machine(queue=100)
    up = play(machine, steps)
    machine.passing = 0
    machine.send()
    machine.send()
    for number, active in up.items():
        said = [what for what, joint in machine.said if joint == number and what != "graver"]
        assert said == ["raised", "cleared"] * (len(said) // 2) + ["raised"] * (len(said) % 2)
        assert active == (len(said) % 2 == 1)
