"""A driver at an emulated server: values, certificates, users, wrong nodes, faults."""

from __future__ import annotations

import itertools
import json
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from asyncua import Server, ua
from asyncua.common.connection import SecureConnection
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_session import InternalSession
from asyncua.server.user_managers import UserManager
from cryptography import x509

from cellwatt.channel import Quality
from cellwatt.demo.cells import free_endpoint
from cellwatt.emulation import Fault
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, WrongDeviceError
from cellwatt_drivers.opc_ua.complaints import Complaints
from cellwatt_drivers.opc_ua.emulator import OpcUaEmulator
from cellwatt_drivers.opc_ua.nodes import misplaced
from cellwatt_drivers.opc_ua.session import Session, open_session
from cellwatt_drivers.opc_ua.tag_map import Tag
from tests.patience import eventually

from ..running import Steady, served
from .rig import PLC, TAGS, certificate, driver, emulated, running, settings

BAD_NODES = [
    (
        {"a.x": {"node": "ns=plc;s=Arm.Positoin", "index": 0, "unit": "deg"}},
        "has no node 'ns=plc;s=Arm.Positoin' (a.x)",
    ),
    ({"a.x": {"node": "ns=plc;s=Arm.Position", "unit": "deg"}}, "is an array of 2: write 'index', from 0"),
    ({"a.x": {"node": "ns=plc;s=Arm.Position", "index": 2, "unit": "deg"}}, "has 2 elements, none with index 2"),
    ({"a.x": {"node": 'ns=plc;s="DB_Arm"."current"', "index": 0, "unit": "A"}}, "is not an array: leave out 'index'"),
    (
        {"a.x": {"path": "plc:Cell/plc:Suply/plc:Power", "unit": "kW"}},
        "has no 'plc:Suply' below Objects/plc:Cell; did you mean 'Supply'? (a.x)",
    ),
    ({"a.x": {"node": "i=2261", "unit": "A"}}, "is a String, expected a number"),
    (
        {"a.x": {"node": "nsu=urn:plant:plcs;s=Arm.Position", "unit": "kW"}},
        "has no namespace 'urn:plant:plcs'; did you mean 'urn:plant:plc'?",
    ),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Certificates and keys by name, as settings."""
    folder = tmp_path_factory.mktemp("certificates")
    uris = {"server": None, "client": None, "stranger": None, "nameless": ""}
    made = {name: certificate(folder, name, uri) for name, uri in uris.items()}
    return {name: dict(zip(("certificate", "key"), map(str, pair), strict=True)) for name, pair in made.items()}


async def test_values_come_in_si_units_with_the_sources_time():
    async with emulated() as (_, place), running(place) as run:
        await run.inlet.until(lambda o: len(o.readings) > 5)
    found = dict(zip(TAGS, run.inlet.values[-1], strict=True))
    assert found == pytest.approx(
        {"joint_1.position": 0.5, "joint_2.position": 0.0, "joint_1.current": 2.5, "supply.power": 500.0}
    )
    assert not run.failures
    late = np.array([r.arrival - r.device_time[-1] for r in run.inlet.readings])
    assert (np.abs(late) < 2e9).all()


async def test_elements_of_arrays_within_arrays():
    tags = {
        "a.x": {"node": "ns=plc;s=Matrix", "index": [1, 0], "unit": "N"},
        "a.y": {"node": "ns=plc;s=Matrix", "index": [0, 2], "unit": "N"},
    }
    options = OpcUaEmulator.options_for([settings("127.0.0.1:1", tags=tags)])
    forces = Steady({"a.x": 3.5, "a.y": -2.0})
    emulator = OpcUaEmulator(forces, "127.0.0.1:0", seed=3, options=options)
    async with served(emulator) as place, running(place, tags=tags) as run:
        await run.inlet.until(lambda o: len(o.readings) > 5)
    assert run.inlet.values[-1].tolist() == [3.5, -2.0]
    assert not run.failures


@pytest.mark.parametrize(
    ("value", "index", "text"),
    [
        ([[1.0, 2.0], [3.0, 4.0]], 0, "is an array of 2 × 2: write 'index', from 0 for each dimension, like [0, 0]"),
        ([[1.0, 2.0], [3.0, 4.0]], (1, 2), "has 2 × 2 elements, none with index 1, 2"),
        ([], 0, "has 0 elements, none with index 0"),
        ([1.0, None], 1, "has None where a number is expected"),
        ([[1.0, 2.0], [3.0, 4.0]], (1, 0), ""),
        (1, None, ""),
    ],
)
def test_an_index_that_leads_to_no_number_is_refused(value, index, text):
    tag = Tag.model_validate({"node": "ns=2;s=x", "index": index, "unit": "N"})
    found = misplaced(value, tag.indices)
    assert text in found and bool(text) == bool(found)


async def test_the_server_says_who_it_is():
    async with emulated() as (_, place):
        identity = await driver(place).identify()
    assert (identity.maker, identity.model, identity.firmware) == ("cellwatt", "emulated controller", "1.0")
    assert identity.notes["nodes"] == "3" and "started" in identity.notes


async def test_a_wrong_node_is_told_with_what_was_near():
    async with emulated() as (_, place):
        for tags, text in BAD_NODES:
            with pytest.raises(WrongDeviceError) as told:
                await driver(place, tags=tags).identify()
            assert text in str(told.value) and place in str(told.value) and "\n" not in str(told.value)


async def test_what_is_optional_may_be_missing():
    tags = TAGS | {"tool.force": {"node": "ns=plc;s=Tool.Force", "unit": "N", "optional": True}}
    async with emulated() as (_, place), running(place, tags=tags) as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
    assert np.isnan(run.inlet.values[:, -1]).all() and np.isfinite(run.inlet.values[:, :-1]).all()
    assert run.inlet.kinds() == ["tags_missing"]
    assert run.driver.left_out == {"tool.force"}


@pytest.mark.parametrize("security", ["sign", "encrypt"])
async def test_messages_are_signed_and_encrypted(files, security):
    its = files["server"] | {"trusted": files["client"]["certificate"]}
    mine = files["client"] | {"security": security}
    users = {"user": "eve", "password": "secret"}
    async with emulated(security="sign,encrypt", **its, **users) as (_, place):
        for pinned in ({}, {"server_certificate": its["certificate"]}):
            identity = await driver(place, **mine, **users, **pinned).identify()
            assert len(identity.notes["certificate (SHA-256)"]) == 64
        async with running(place, **mine, **users) as run:
            await run.inlet.until(lambda o: len(o.readings) > 2)
            assert not run.failures


async def test_a_certificate_that_the_server_does_not_trust_is_refused(files):
    its, stranger = files["server"] | {"trusted": files["client"]["certificate"]}, files["stranger"]
    async with emulated(security="sign,encrypt", **its) as (_, place):
        with pytest.raises(DeviceError, match=r"refuses this PC's certificate .*BadCertificateUntrusted; trust it"):
            await driver(place, security="encrypt", **stranger).identify()
        pinned = {"security": "encrypt", "server_certificate": stranger["certificate"], "timeout": "300 ms"}
        with pytest.raises(ConnectError, match="does it trust this PC's certificate, is the pinned one its own"):
            await driver(place, **files["client"], **pinned).identify()


@pytest.mark.parametrize(
    ("its", "mine", "text"),
    [
        ("none", "sign", "offers no Basic256Sha256 Sign; it offers: None None"),
        ("encrypt", "none", "does not offer this 'security': write another"),
    ],
)
async def test_a_server_without_this_security_is_not_read(files, its, mine, text):
    async with emulated(security=its, **files["server"]) as (_, place):
        with pytest.raises(DeviceError, match=text):
            await driver(place, security=mine, **files["client"] if mine == "sign" else {}).identify()


async def test_files_that_are_no_certificates_are_told(files, tmp_path):
    junk = tmp_path / "junk.pem"
    junk.write_text("-----BEGIN nothing")
    for mine, text in (
        (files["client"] | {"certificate": junk}, f"{junk} cannot be used"),
        (files["client"] | {"key": junk}, f"{junk} cannot be used"),
        (files["nameless"], "names no application URI"),
    ):
        with pytest.raises(DeviceError, match=text):
            await driver("127.0.0.1:9", security="sign", **mine).identify()


async def test_a_user_is_refused_and_a_password_is_not_sent_in_plain_text():
    async with emulated(user="eve", password="secret") as (_, place):
        with pytest.raises(DeviceError, match="refuses a client without a user: write 'user' and 'password'"):
            await driver(place).identify()
        with pytest.raises(DeviceError, match="accepts the password in plain text only"):
            await driver(place, user="eve", password="secret").identify()
        with pytest.raises(DeviceError, match="refuses user 'eve'") as told:
            await driver(place, user="eve", password="wrong", unencrypted=True).identify()
        assert "wrong" not in str(told.value)
        assert await driver(place, user="eve", password="secret", unencrypted=True).identify()


class Known(UserManager):
    """Lets in whoever has one of some certificates."""

    def __init__(self, *files):
        self.known = [x509.load_pem_x509_certificate(file.read_bytes()) for file in files]

    def get_user(self, iserver, username=None, password=None, certificate=None):
        shown = x509.load_der_x509_certificate(certificate) if isinstance(certificate, bytes) else certificate
        return User(role=UserRole.User) if shown in self.known else None


async def test_a_user_comes_in_by_a_certificate(files):
    """A server that knows users by their certificates alone; this PC's own is another."""
    eve, mallory = ({f"user_{k}": v for k, v in files[who].items()} for who in ("nameless", "stranger"))
    server = Server(user_manager=Known(Path(eve["user_certificate"])))
    await server.init()
    url = f"opc.tcp://127.0.0.1:{free_endpoint().rpartition(':')[2]}"
    server.set_endpoint(url)
    server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
    await server.load_certificate(files["server"]["certificate"])
    await server.load_private_key(files["server"]["key"])
    await server.set_application_uri("urn:test:server")
    server.set_identity_tokens([ua.X509IdentityToken])
    async with server:

        async def enter(**user):
            made = driver(url.removeprefix("opc.tcp://"), security="encrypt", **files["client"], **user)
            async with open_session(made.settings) as session:
                return await session.value(ua.ObjectIds.Server_NamespaceArray)

        assert "http://opcfoundation.org/UA/" in await enter(**eve)
        with pytest.raises(DeviceError, match=r"refuses user 'stranger.pem'"):
            await enter(**mallory)
        with pytest.raises(DeviceError, match=r"stranger.pem cannot be used"):
            await enter(**eve | {"user_key": mallory["user_certificate"]})


async def test_bad_values_are_missing_and_counted():
    async with emulated() as (emulator, place), running(place) as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
        emulator.inject(Fault("garbage", duration=0.3))
        await run.inlet.until(lambda o: o.account.counters["bad status"] > 0)
        await run.inlet.until(lambda o: o.readings[-1].quality[-1] == Quality.GOOD)
    assert run.inlet.account.counters["status BadSensorFailure"] == run.inlet.account.counters["bad status"]
    quality = np.concatenate([r.quality for r in run.inlet.readings])
    missing = quality == Quality.MISSING
    assert missing.any() and np.isnan(run.inlet.values[missing]).all()
    assert np.isfinite(run.inlet.values[~missing]).all()


async def test_what_the_servers_queue_lost_is_counted():
    async with emulated() as (emulator, place), running(place) as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
        emulator.inject(Fault("loss", duration=0.3))
        await run.inlet.until(lambda o: o.account.counters["overflows"] > 0)
    assert "overflows" in run.inlet.account.anomalies


async def test_a_restart_of_the_server_is_an_outage_and_no_more():
    async with emulated() as (emulator, place), running(place) as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
        emulator.inject(Fault("disconnect", seconds=0.5))
        await run.inlet.until(lambda o: len(o.identities) > 1 and o.account.missed["outage"] > 0)
    assert "the server closed the connection" in str(run.failures[0])
    assert not run.inlet.resets


async def test_a_server_that_says_nothing_is_given_up():
    async with emulated() as (emulator, place), running(place, silence="300 ms", timeout="300 ms") as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
        emulator.inject(Fault("stall", seconds=1.0))
        await run.inlet.until(lambda _: run.failures)
        assert "no keep-alive of the subscription for 0.3 s" in str(run.failures[0])
        before = len(run.inlet.readings)
        await run.inlet.until(lambda o: len(o.readings) > before)


async def test_keys_that_cannot_be_renewed_end_the_session():
    def renew(**_: bool) -> None:
        raise ValueError("no key")

    url = "opc.tcp://127.0.0.1:4840"
    session = Session(SimpleNamespace(secure_channel_timeout=0, open_secure_channel=renew), Complaints(url, ""))
    await session.renew()
    with pytest.raises(ProtocolError, match="no key while renewing the secure channel"):
        await session.feed.given(1.0)


async def test_keys_are_renewed_at_a_server_whose_clock_is_years_behind(monkeypatch):
    """As a PLC without battery; its messages under the old key still come for a while."""
    renewals = 0
    known = SecureConnection.set_channel

    def set_channel(self: SecureConnection, params: Any, *rest: Any) -> None:
        nonlocal renewals
        renewals += 1
        params.SecurityToken.CreatedAt = datetime(1970, 1, 1, tzinfo=UTC)
        known(self, params, *rest)

    monkeypatch.setattr(SecureConnection, "set_channel", set_channel)
    monkeypatch.setattr("cellwatt_drivers.opc_ua.session._RENEWED_AFTER", 0.05 / 3600)
    async with emulated() as (_, place), running(place) as run:
        await run.inlet.until(lambda o: renewals >= 6 and len(o.readings) > 20)
    assert not run.failures


async def test_a_server_that_takes_one_node_at_once_is_read_node_by_node(monkeypatch):
    known = InternalSession.read

    async def read(self: InternalSession, params: Any) -> Any:
        if self.external and len(params.NodesToRead) > 1:
            raise ua.uaerrors.BadTooManyOperations
        return await known(self, params)

    monkeypatch.setattr(InternalSession, "read", read)
    async with emulated() as (_, place), running(place) as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
    assert not run.failures


@pytest.mark.parametrize("how", ["told", "untold", "unpublished"])
async def test_nodes_that_were_removed_or_are_no_longer_published_end_the_session(how):
    """eclipse-milo/milo #393: after a download to the PLC, notifications stop."""
    async with emulated() as (emulator, place), running(place, silence="200 ms") as run:
        await run.inlet.until(lambda o: len(o.readings) > 2)
        server: Server = emulator._server._server
        node = ua.NodeId('"DB_Arm"."current"', await server.get_namespace_index("urn:plant:plc"))
        nodes, currents = server.iserver.aspace, itertools.count(7)
        if how == "told":
            gone = ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadNodeIdUnknown))
            await server.write_attribute_value(node, gone)
        else:
            nodes[node].attributes[ua.AttributeIds.Value].datachange_callbacks.clear()
        if how == "untold":
            del nodes[node]

        async def has_ended() -> bool:
            if how == "unpublished":
                await server.write_attribute_value(node, ua.DataValue(ua.Variant(float(next(currents)))))
            return bool(run.failures)

        await eventually(has_ended)
    told = "no longer publishes it" if how == "unpublished" else "the server has removed nodes (BadNodeIdUnknown)"
    assert told in str(run.failures[0])


@pytest.mark.parametrize(
    ("status", "advice"),
    [
        ("BadCertificateTimeInvalid", "has it expired, is this PC's or the server's clock wrong?"),
        ("BadCertificateUriInvalid", "its application URI (subjectAltName) is not accepted"),
        ("BadCertificateUntrusted", "trust it at the server"),
    ],
)
def test_a_refused_certificate_comes_with_what_to_do(status, advice):
    refused = Complaints("opc.tcp://plc", "").refusal("connecting", ua.StatusCode(getattr(ua.StatusCodes, status)))
    assert f"refuses this PC's certificate: {status}; {advice}" in str(refused)


async def test_every_sample_is_asked_for():
    async with emulated() as (_, place), running(place, every_sample=True) as run:
        await run.inlet.until(lambda o: sum(len(r.values) for r in o.readings) > 10)
    assert run.inlet.account.counters["unchanged"] < 5  # the world stands still: without it all but one


async def test_channels_of_any_robot_by_its_standard_nodes():
    many = {"model": "opc_40010", "tags": {}, "namespaces": {}, "read": ["joint_2.position", "joint_6.temperature"]}
    async with emulated(tags="", namespaces="") as (_, place):
        made = driver(place, **many)
        assert (await made.identify()).notes["nodes"] == "2"
        assert [c.unit for c in made.streams[0].channels] == ["rad", "degC"]


async def test_units_of_the_server_decide_or_are_held_against_ours():
    tag = {"node": "ns=plc;s=Angle", "unit": "deg", "server_unit": True}
    its = {"tags": json.dumps({"joint_1.position": tag}), "namespaces": json.dumps(PLC["namespaces"])}
    async with emulated(**its) as (_, place):
        for unit, refusal in (("deg", None), ("rad", None), ("mm", "is in deg, the settings say mm")):
            wanted = tag | {"unit": unit, "server_unit": unit == "rad"}
            made = driver(place, tags={"joint_1.position": wanted})
            if refusal:
                with pytest.raises(WrongDeviceError, match=refusal):
                    await made.identify()
                continue
            async with running(place, tags={"joint_1.position": wanted}) as run:
                await run.inlet.until(lambda o: len(o.readings) > 1)
            assert run.inlet.values[-1, 0] == pytest.approx(0.5, rel=1e-6)
