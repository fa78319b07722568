from __future__ import annotations

import pytest

from cellwatt.config.installed import installed
from cellwatt.host import check_host
from cellwatt.outlets.zenoh.link import LinkSettings

GOOD = ["192.0.2.10", "arm-3.plant", "localhost", "::1", "fe80::1%eth0", "a_b", "x" * 63, "robot.", "3"]
BAD = {
    "empty": "",
    "a line break": "arm\n",
    "a user": "user:password@arm",
    "a number beyond 255": "192.168.1.300",
    "three numbers": "192.168.1",
}


@pytest.mark.parametrize("host", GOOD)
def test_good_hosts(host: str) -> None:
    assert check_host(host) == host


@pytest.mark.parametrize("host", BAD.values(), ids=BAD)
def test_bad_hosts(host: str) -> None:
    with pytest.raises(ValueError, match=r"host name|IP address"):
        check_host(host)


@pytest.mark.parametrize(
    ("host", "proposal"),
    [
        ("tcp://192.168.1.30", "did you mean '192.168.1.30'?"),
        ("http://arm.plant/rw", "did you mean 'arm.plant'?"),
        ("192.168.1.30:502", "did you mean '192.168.1.30', with the port as a separate key?"),
        ("opc.tcp://anna:secret@arm:4840/x", "did you mean 'arm', with the port as a separate key?"),
        (" arm ", "did you mean 'arm'?"),
    ],
)
def test_the_host_within_what_was_written_is_proposed(host: str, proposal: str) -> None:
    with pytest.raises(ValueError, match="expected a host name") as refused:
        check_host(host)
    assert str(refused.value).endswith(f"like 192.0.2.10 or arm-3.plant; {proposal}")
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("part", [p for p in installed("driver") if p.settings and "host" in p.settings.model_fields],
                         ids=lambda p: p.name)  # fmt: skip
def test_every_driver_refuses_a_host_that_is_none(part) -> None:
    with pytest.raises(ValueError, match="at most 253 characters, this one has 300"):
        part.settings.model_validate({"host": "h" * 300})


def test_endpoints_too() -> None:
    with pytest.raises(ValueError, match="at most 253 characters"):
        LinkSettings(connect=(f"tcp/{'h' * 300}:7447",))
    assert LinkSettings(listen=("tcp/[::]:7447", "tcp/0.0.0.0:7447")).listen
