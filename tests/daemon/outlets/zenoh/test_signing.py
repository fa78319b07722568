"""Signed messages: what a signature covers, and a subscriber on a bus on which anybody may put anything."""

from __future__ import annotations

import json
import subprocess
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import zenoh
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from cellwatt import Alarm, ConfigError, OutletError
from cellwatt.door.signing import Signer, Verifier
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item, health
from cellwatt.outlets.zenoh.signing import MessageSigner, MessageVerifier
from cellwatt.subscriber import Gap, Health, Message, Subscriber
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, alarm, batch, sample
from tests.daemon.outlets.zenoh.serving import serving
from tests.doing import doing
from tests.patience import eventually

ROOT = f"cellwatt/{SITE}/{CELL}"
RAW = "raw/arm/samples"
STANDS = Mark(EPOCH, 1, 1, EPOCH)


def seal(keys: Path, name: str = "cell") -> MessageSigner:
    made = MessageSigner(ROOT, keys / f"{name}.key")
    made.open()
    return made


def test_openssl_verifies_what_the_page_says_is_signed(keys: Path) -> None:
    mark, payload = Mark(EPOCH, 7, 1, EPOCH).encode(b"payload"), b"payload"
    signed = seal(keys).message("alarm", mark, payload)
    assert signed[:-64] == mark
    parts = (b"cellwatt: message of a cell, version 1", ROOT.encode(), b"alarm", mark, payload)
    (keys / "signed").write_bytes(b"".join(len(p).to_bytes(8, "little") + p for p in parts))
    (keys / "signature").write_bytes(signed[-64:])
    command = "openssl pkeyutl -verify -rawin -pubin -inkey cell.pub -in signed -sigfile signature"
    subprocess.run(command.split(), cwd=keys, check=True, capture_output=True)


def holds(keys: Path, topic: str, attachment: bytes, payload: bytes, root: str = ROOT, name: str = "cell") -> bool:
    """True if a consumer takes it for the cell's own."""
    return MessageVerifier(root, keys / f"{name}.pub", Counter()).message(topic, sample(payload, attachment))


def test_nothing_of_a_message_can_be_changed(keys: Path) -> None:
    mark, payload = Mark(EPOCH, 7, 1, EPOCH).encode(b"payload"), b"payload"
    signed = seal(keys).message("alarm", mark, payload)
    assert holds(keys, "alarm", signed, payload)
    for i in range(len(signed)):
        assert not holds(keys, "alarm", signed[:i] + bytes([signed[i] ^ 1]) + signed[i + 1 :], payload)
        assert not holds(keys, "alarm", signed[:i], payload)
    assert not holds(keys, "alarm", signed, b"payloaD")
    assert not holds(keys, "alarm", signed[:-64] + b"p" + signed[-64:], b"ayload")
    assert not holds(keys, "event", signed, payload)
    assert not holds(keys, "alarm", signed, payload, root=f"cellwatt/{SITE}/weld-4")
    assert not holds(keys, "alarm", signed, payload, name="other")
    assert not holds(keys, "alarm", mark, payload)


def test_a_refusal_holds_for_its_question_alone(keys: Path) -> None:
    check = MessageVerifier(ROOT, keys / "cell.pub", Counter())
    body = json.dumps(seal(keys).refusal("first=0;count=5", "nothing kept")).encode()
    assert check._refused("first=0;count=5", body)
    assert not check._refused("first=0;count=6", body)
    assert not check._refused("first=0;count=5", body.replace(b"nothing", b"no"))
    unsigned = (b'{"error": "x"}', b'{"error": "x", "signature": 5}', b'{"error": "", "signature": "z"}')
    for wrong in (*unsigned, b"[]", b"\xff"):
        assert not check._refused("first=0;count=5", wrong)


def test_a_certificate_or_several_keys_will_do(keys: Path) -> None:
    signature = Signer(keys / "cell.key").sign("part")
    both = keys / "both.pem"
    command = "openssl req -x509 -key cell.key -subj /CN=weld-3"
    certificate = subprocess.run(command.split(), cwd=keys, check=True, capture_output=True).stdout
    both.write_bytes((keys / "other.pub").read_bytes() + certificate)
    assert Verifier(both).holds(signature, "part")
    both.write_bytes((keys / "other.pub").read_bytes() + (keys / "cell.pub").read_bytes())
    assert Verifier(both).holds(signature, "part")
    assert not Verifier(keys / "other.pub").holds(signature, "part")


def test_files_that_hold_no_such_key_are_named(keys: Path) -> None:
    wrong = keys / "wrong.pem"
    curve = ec.generate_private_key(ec.SECP256R1())
    for text, of_private in (
        (b"none", "no private key that is readable without a password"),
        (
            curve.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
            "a key of another kind; expected Ed25519",
        ),
    ):
        wrong.write_bytes(text)
        with pytest.raises(ConfigError, match=of_private):
            Signer(wrong)
        with pytest.raises(ConfigError, match="has no Ed25519 public key or certificate"):
            Verifier(wrong)
    with pytest.raises(ConfigError, match=r"none cannot be read: No such file"):
        Verifier(keys / "none")
    with pytest.raises(OutletError, match=r"^sign: .*none cannot be read: No such file"):
        MessageSigner(ROOT, keys / "none").open()


@pytest.fixture
def attacker(bus: LinkSettings) -> Iterator[zenoh.Session]:
    with open_session(bus) as session:
        yield session


@asynccontextmanager
async def signing_cell(bus: LinkSettings, keys: Path, session: int = EPOCH) -> AsyncIterator[ZenohOutlet]:
    outlet = ZenohOutlet("zenoh", ZenohSettings(**bus.model_dump(), sign=keys / "cell.key"), FakeView(session))
    async with serving(outlet):
        yield outlet


def subscriber(bus: LinkSettings, keys: Path, *want: str, **more: Any) -> Subscriber:
    return Subscriber(SITE, CELL, bus, want=want, verify=keys / "cell.pub", **more)


@asynccontextmanager
async def reading(cell: Subscriber) -> AsyncIterator[list[Message]]:
    found: list[Message] = []

    async def read() -> None:
        async for message in cell:
            found.append(message)  # noqa: PERF401 – who waits looks at the list meanwhile

    async with doing(read()):
        await eventually(lambda: cell._inbox.following.joined, "the subscriber to know where the cell is")
        yield found


async def test_all_that_a_cell_says_passes_the_check(bus: LinkSettings, keys: Path) -> None:
    """Live samples, what was missed, what is gone for ever, alarms of before, health: nothing is refused."""
    async with signing_cell(bus, keys) as outlet:
        view: Any = outlet.view
        outlet.offer(alarm(0))
        async with (
            subscriber(bus, keys, RAW, "alarm", "health", patience=0.5) as cell,
            Subscriber(SITE, CELL, bus, want=(RAW, "alarm")) as plain,
            reading(cell) as found,
            reading(plain) as found_plain,
        ):
            view.record(batch(0, 30))
            outlet.offer(batch(0, 10))
            outlet.offer(batch(20, 10))  # 10 … 19 are asked for
            view.record(batch(40, 10))
            outlet.offer(batch(40, 10))  # 30 … 39 nobody has
            await eventually(lambda: any(m.sequence == 40 and m.topic == RAW for m in found), "all samples")
            await eventually(lambda: any(m.topic == "alarm" for m in found), "the alarm of before")
            await eventually(lambda: any(isinstance(m.content, Health) for m in found), "health")
            await eventually(lambda: any(m.topic == RAW for m in found_plain), "samples where nobody checks")
            counts, counts_plain = cell.counts, plain.counts
    raw = [(m.sequence, m.count, isinstance(m.content, Gap)) for m in found if m.topic == RAW]
    assert raw == [(0, 10, False), (10, 10, False), (20, 10, False), (30, 10, True), (40, 10, False)]
    assert not {"unsigned", "replayed", "unreadable"} & {k for k, n in counts.items() if n}, counts
    assert "unsigned" not in counts_plain


async def test_what_the_cell_has_not_signed_is_left_out_and_counted(
    bus: LinkSettings, keys: Path, attacker: zenoh.Session
) -> None:
    key = f"{ROOT}/alarm/error/joint_fault"
    forged = encode_item(alarm(99), Mark(EPOCH, 1, 1, EPOCH))
    mark = Mark(EPOCH, 0, 1, EPOCH).encode(forged)
    attachments = [None, b"", mark, mark + bytes(64), seal(keys, "other").message("alarm", mark, forged)]
    attachments.append(seal(keys).message("event", mark, forged))
    lie = health(STANDS, EPOCH, {"alarm": (EPOCH, 10**12)}, {"state": "green"})
    async with (
        signing_cell(bus, keys) as outlet,
        subscriber(bus, keys, "alarm") as cell,
        reading(cell) as found,
    ):
        for attachment in attachments:
            attacker.put(key, forged, attachment=attachment)
        attacker.put(f"{ROOT}/health", lie, attachment=STANDS.encode(lie))
        await eventually(lambda: cell.counts.get("unsigned") == len(attachments) + 1, "all forged messages")
        outlet.offer(alarm(0))
        await eventually(lambda: found, "the cell's own alarm")
        assert [m.content.joint for m in found if isinstance(m.content, Alarm)] == [0]
        assert "lost" not in cell.counts


async def test_answers_and_refusals_of_others_are_left_out(
    bus: LinkSettings, keys: Path, attacker: zenoh.Session
) -> None:
    """Somebody else answers faster, with samples, with status, and with 'nothing is left': the cell's answer counts."""

    def lie(query: zenoh.Query) -> None:
        with query:
            query.reply_err(b'{"error": "nothing is kept"}')

    def lie_of_status(query: zenoh.Query) -> None:
        with query:
            payload = health(STANDS, EPOCH, {RAW: (EPOCH, 10**12)}, {})
            query.reply(f"{ROOT}/@/status", payload, attachment=STANDS.encode(payload))

    async with signing_cell(bus, keys) as outlet:
        view: Any = outlet.view
        attacker.declare_queryable(f"{ROOT}/@/history", lie)
        attacker.declare_queryable(f"{ROOT}/@/status", lie_of_status)
        async with subscriber(bus, keys, RAW, patience=0.0) as cell, reading(cell) as found:
            view.record(batch(0, 30))
            outlet.offer(batch(0, 10))
            outlet.offer(batch(20, 10))
            await eventually(lambda: sum(m.count for m in found) == 30, "what was missed")
            await eventually(lambda: cell.counts.get("unsigned", 0) >= 2, "the lies")
            assert not [m for m in found if isinstance(m.content, Gap)]


Kept = list[tuple[str, bytes, bytes | None]]


def keep_all(attacker: zenoh.Session) -> Kept:
    """What the attacker hears from now on."""
    kept: Kept = []

    def keep(sample: zenoh.Sample) -> None:
        attachment = None if sample.attachment is None else sample.attachment.to_bytes()
        kept.append((str(sample.key_expr), sample.payload.to_bytes(), attachment))

    attacker.declare_subscriber(f"{ROOT}/**", keep)
    return kept


def kinds(kept: Kept) -> set[str]:
    return {key.split("/")[3] for key, _, _ in list(kept)}


async def test_an_earlier_session_cannot_be_shown_again(bus: LinkSettings, keys: Path, attacker: zenoh.Session) -> None:
    """Alarms and health that the cell signed before its daemon began anew, kept by who carried them."""
    kept = keep_all(attacker)
    async with signing_cell(bus, keys) as outlet:
        numbers, both = count(), {"alarm", "health"}
        await eventually(lambda: outlet.offer(alarm(next(numbers))) or kinds(kept) >= both, "one of each to keep")
    old = list(kept)
    async with (
        signing_cell(bus, keys, EPOCH + 10**12) as outlet,
        subscriber(bus, keys, "alarm", "health") as cell,
        reading(cell) as found,
    ):
        outlet.offer(alarm(500))
        await eventually(lambda: any(isinstance(m.content, Alarm) for m in found), "the cell's own alarm")
        await eventually(lambda: any(isinstance(m.content, Health) for m in found), "the cell's own health")
        for key, payload, attachment in old:
            attacker.put(key, payload, attachment=attachment)
        attacker.put(f"{ROOT}/health", b"", attachment=b"")
        await eventually(lambda: cell.counts.get("unsigned"), "all that was shown again")
        await eventually(lambda: not cell._inbox.following._unsure, "the cell's word against it")
        outlet.offer(alarm(501))
        await eventually(lambda: 501 in joints(found), "the next alarm")
        assert set(joints(found)) == {500, 501}
        assert {m.content.session for m in found if isinstance(m.content, Health)} == {EPOCH + 10**12}


def joints(found: list[Message]) -> list[int | None]:
    return [m.content.joint for m in list(found) if isinstance(m.content, Alarm)]


async def test_health_of_before_cannot_be_shown_again(bus: LinkSettings, keys: Path, attacker: zenoh.Session) -> None:
    """'All is well', said by the cell itself some time ago."""
    kept = keep_all(attacker)
    async with (
        signing_cell(bus, keys),
        subscriber(bus, keys, "health") as cell,
        reading(cell) as found,
    ):
        await eventually(lambda: kept and len(found) >= 3, "some health messages")
        old = kept[0]
        for _ in range(5):
            attacker.put(old[0], old[1], attachment=old[2])
        await eventually(lambda: cell.counts.get("replayed") == 5, "all that was shown again")
        times = [m.content.time for m in found if isinstance(m.content, Health)]
        assert times == sorted(set(times))


async def test_an_answer_of_before_cannot_be_given_again(
    bus: LinkSettings, keys: Path, attacker: zenoh.Session
) -> None:
    """The cell's own status of an earlier session, given to a subscriber that begins: its question is another."""
    async with signing_cell(bus, keys):
        question = f"{ROOT}/@/status"
        ask = lambda: [r.ok for r in attacker.get(question, timeout=1.0) if r.ok is not None]  # noqa: E731
        (old, *_) = await eventually(ask, "an answer to keep")
    payload, attachment = old.payload.to_bytes(), old.attachment.to_bytes()

    def again(query: zenoh.Query) -> None:
        with query:
            query.reply(question, payload, attachment=attachment)

    attacker.declare_queryable(question, again)
    async with subscriber(bus, keys, "alarm") as cell:
        await eventually(lambda: cell.counts.get("unsigned", 0) > 0, "the answer of before")
        assert not cell._inbox.following.joined
