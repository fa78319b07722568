"""Errors of a server or of the library, as errors for the person at the cell."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError, why
from cellwatt_drivers.shared.aside import obey_cancellation

if TYPE_CHECKING:
    from asyncua import ua

_TIME: Final = "has it expired, is this PC's or the server's clock wrong?"
_CERTIFICATE: Final = {
    "BadCertificateTimeInvalid": _TIME,
    "BadCertificateIssuerTimeInvalid": _TIME,
    "BadCertificateUriInvalid": "its application URI (subjectAltName) is not accepted: make a certificate with one",
    "BadCertificateUseNotAllowed": "its keyUsage or extendedKeyUsage is not accepted: make it as on the page opc_ua",
} | dict.fromkeys(
    ("BadCertificateUntrusted", "BadSecurityChecksFailed", "BadCertificateInvalid", "BadCertificateHostNameInvalid",
     "BadCertificateRevoked", "BadCertificateChainIncomplete"),
    "trust it at the server",
)  # fmt: skip
"""What to do, by the status with which a server refuses a certificate."""
_MODE: Final = ("BadSecurityPolicyRejected", "BadSecurityModeRejected", "No matching endpoints")
_USER: Final = ("BadUserAccessDenied", "BadIdentityTokenRejected", "BadIdentityTokenInvalid")
_TOO_MANY: Final = ("BadTooManySessions", "BadMaxConnectionsReached", "BadTooManySubscriptions")
_ENDED: Final = ("BadSessionClosed", "BadSessionIdInvalid", "BadSecureChannelClosed", "BadConnectionClosed")


class Complaints:
    """Translates errors of one connection; ``certificate`` is the thumbprint of this PC's certificate, or empty."""

    def __init__(self, url: str, user: str) -> None:
        self.certificate = ""
        self._url = url
        self._user = user

    def gone(self) -> ConnectError:
        """Return the error of a connection that the server or the network closed."""
        return ConnectError(f"{self._url}: the server closed the connection")

    def strange(self, what: str) -> ProtocolError:
        """Return the error of an invalid answer."""
        return ProtocolError(f"{self._url}: {what}")

    def mode(self) -> DeviceError:
        """Return the error of a server without the wanted security."""
        return DeviceError(f"{self._url} does not offer this 'security': write another (encrypt, sign, none)")

    @contextmanager
    def about(self, doing: str) -> Iterator[None]:
        """Raise every exception of the body as a ``SourceError`` that names the action ``doing``."""
        from asyncua import ua

        doubt = " (does it trust this PC's certificate, is the pinned one its own?)"
        hint = doubt if self.certificate and "channel" in doing else ""
        try:
            yield
        except SourceError:
            raise
        except ua.UaStatusCodeError as error:
            raise self.refusal(doing, ua.StatusCode(error.code)) from error
        except TimeoutError as error:
            raise ConnectError(f"{self._url}: no answer in time while {doing}{hint}") from error
        except ConnectionError as error:
            reason = why(error) if error.errno else "the server closed the connection"
            raise ConnectError(f"{self._url}: {reason} while {doing}{hint}") from error
        except OSError as error:
            raise ConnectError(f"{self._url}: {why(error)} while {doing}") from error
        except AssertionError as error:  # the library received a fault instead of an answer
            raise DeviceError(f"{self._url}: the server refuses {doing}{hint}") from error
        except Exception as error:  # the library lets exceptions of its parsers and cryptography through
            text = " ".join(str(error).split()) or type(error).__name__
            if text.startswith(_MODE):
                raise self.mode() from error
            raise ProtocolError(f"{self._url}: {text} while {doing}") from error
        else:
            obey_cancellation()

    def refusal(self, doing: str, status: ua.StatusCode) -> SourceError:
        """Return the error of a request that the server refused."""
        name, doc = status.name, status.doc
        if advice := _CERTIFICATE.get(name):
            mine = f" (SHA-1 {self.certificate})" if self.certificate else ""
            return DeviceError(f"{self._url} refuses this PC's certificate{mine}: {name}; {advice}")
        if name in _MODE:
            return self.mode()
        if name in _USER:
            whom = f"user {self._user!r}" if self._user else "a client without a user: write 'user' and 'password'"
            return DeviceError(f"{self._url} refuses {whom} ({name})")
        if name in _TOO_MANY:
            return DeviceError(f"{self._url} accepts no further client ({name}): end one, or wait for its time-out")
        if name in _ENDED:
            return ConnectError(f"{self._url}: the server ended the session ({name}) while {doing}")
        return DeviceError(f"{self._url}: {name} while {doing}: {doc}")
