"""Why a server was not reached, in words."""

from __future__ import annotations

import ssl

import pytest

from cellwatt.outlets.remote import unreached


def refused(code: int, message: str) -> ssl.SSLCertVerificationError:
    error = ssl.SSLCertVerificationError(1, "certificate verify failed")
    error.verify_code, error.verify_message = code, message
    return error


def failed(reason: str) -> ssl.SSLError:
    error = ssl.SSLError(1, f"[SSL: {reason}]")
    error.reason = reason
    return error


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (refused(9, "certificate is not yet valid"), "is not yet valid; is the clock of this PC right?"),
        (refused(10, "certificate has expired"), "has expired; is the clock of this PC right?"),
        (refused(62, "Hostname mismatch"), "its certificate is not trusted: Hostname mismatch"),
        (failed("WRONG_VERSION_NUMBER"), "TLS failed: WRONG_VERSION_NUMBER; is this a port for TLS?"),
        (failed("TLSV1_ALERT_PROTOCOL_VERSION"), "it must speak TLS 1.2 or later"),
        (failed("TLSV13_ALERT_CERTIFICATE_REQUIRED"), "the server refuses this PC: check certificate and key"),
    ],
)
def test_why_tls_failed_is_told_with_what_to_check(error: ssl.SSLError, told: str) -> None:
    assert told in unreached(error)
    assert ("clock" in unreached(error)) == ("valid" in told or "expired" in told)
