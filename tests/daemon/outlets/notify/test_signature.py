"""Signatures of webhooks, against a known vector and an independent calculation."""

from __future__ import annotations

from cellwatt.outlets.notify.web import key_of, sign


def test_the_example_of_the_specification() -> None:
    secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
    found = sign(secret, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}')
    assert found == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_a_secret_that_only_looks_like_base64_is_a_text() -> None:
    assert key_of("whsec_not base64") == b"whsec_not base64"
