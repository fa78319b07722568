"""Logins across restarts, and tries at passwords by the clock."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from cellwatt.door.tries import LONGEST, Guard
from cellwatt.outlets.page.sessions import FILE, LASTS, MOST, Sessions


class World:
    """Users, and a clock."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / FILE
        self.proofs = {"ada": "p1", "eve": "p2"}
        self.now = 1e9

    def sessions(self) -> Sessions:
        made = Sessions(self.file, self.proofs.get, lambda: self.now)
        made.load()
        return made


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def test_a_login_survives_a_restart_and_its_token_is_not_on_disk(world: World) -> None:
    before = world.sessions()
    token = before.begin("ada")
    before.save()
    assert token not in world.file.read_text()
    assert world.file.stat().st_mode & 0o777 == 0o600
    after = world.sessions()
    assert after.name_of(token) == "ada"
    assert after.csrf(token) == before.csrf(token)
    after.end(token)
    after.save()
    assert world.sessions().name_of(token) is None


def test_a_login_ends_with_its_time_its_password_and_its_user(world: World) -> None:
    sessions = world.sessions()
    old = sessions.begin("ada")
    assert not any(map(sessions.name_of, ("", "x", "\ud800")))
    world.now += LASTS + 1
    assert sessions.name_of(old) is None
    changed = sessions.begin("ada")
    gone = sessions.begin("eve")
    world.proofs["ada"] = "other"
    del world.proofs["eve"]
    assert sessions.name_of(changed) is None
    assert sessions.name_of(gone) is None
    assert sessions.name_of(sessions.begin("eve")) is None


def test_a_login_that_is_used_goes_on(world: World) -> None:
    sessions = world.sessions()
    token = sessions.begin("ada")
    for _ in range(5):
        world.now += 0.9 * LASTS
        assert sessions.name_of(token) == "ada"


def test_logins_are_bounded(world: World) -> None:
    sessions = world.sessions()
    first = sessions.begin("ada")
    world.now += 1
    last = [sessions.begin("ada") for _ in range(MOST)][-1]
    assert sessions.name_of(first) is None
    assert sessions.name_of(last) == "ada"


def test_a_file_that_is_damaged_or_that_others_may_read_is_void(world: World, caplog: pytest.LogCaptureFixture) -> None:
    for content in ("", '{"secret": "zz", "logins": {}}', '{"secret": "00", "logins": {"a": 5}}', None):
        sessions = world.sessions()
        token = sessions.begin("ada")
        sessions.save()
        assert world.sessions().name_of(token) == "ada"
        caplog.clear()
        if content is None:
            world.file.chmod(0o644)
        else:
            world.file.write_text(content)
        assert world.sessions().name_of(token) is None
        assert "everybody has to log in again" in caplog.text
    assert "other users may read it" in caplog.text


def test_a_folder_that_cannot_be_written_is_told(world: World, caplog: pytest.LogCaptureFixture) -> None:
    world.file = world.file.parent / "none" / FILE
    sessions = world.sessions()
    token = sessions.begin("ada")
    sessions.save()
    assert "logins end with this process" in caplog.text
    assert sessions.name_of(token) == "ada"


# tries --------------------------------------------------------------------------------------------


def guard(now: list[float]) -> Guard:
    """A guard at a time."""
    return Guard("door", Counter(), lambda: now[0])


def test_after_five_tries_the_wait_doubles_up_to_five_minutes() -> None:
    now: list[float] = [0.0]
    door, waits = guard(now), []
    for _ in range(20):
        waits.append(door.begin("192.0.2.1", "ada"))
        if waits[-1]:
            now[0] += waits[-1]
            assert door.begin("192.0.2.1", "ada") == 0.0
    assert waits[:10] == [0, 0, 0, 0, 0, 1, 2, 4, 8, 16]
    assert waits[-1] == LONGEST


def test_tries_count_by_address_and_by_name() -> None:
    door = guard([0.0])
    for _ in range(5):
        door.begin("192.0.2.1", "ada")
    assert door.begin("192.0.2.1", "eve") == 1.0
    assert door.begin("192.0.2.2", "ada") == 1.0
    assert door.begin("127.0.0.1", "ada") == 1.0
    assert door.begin("192.0.2.2", "eve") == 0.0
    door.succeed("192.0.2.1", "ada")
    assert door.begin("192.0.2.1", "ada") == 0.0


def test_tries_are_forgotten_in_time_and_number(monkeypatch: pytest.MonkeyPatch) -> None:
    now: list[float] = [0.0]
    door = guard(now)
    for _ in range(5):
        door.begin("127.0.0.1", "ada")
    now[0] = 4000.0
    assert [door.begin("127.0.0.1", "ada") for _ in range(2)] == [0.0, 0.0]
    monkeypatch.setattr("cellwatt.door.tries.MOST", 10)
    for number in range(100):
        door.begin("127.0.0.1", str(number))
    assert len(door._failed) == 10
