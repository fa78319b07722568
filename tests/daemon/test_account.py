"""What an account tells of samples and of what is strange."""

from __future__ import annotations

from cellwatt.account import Account


def test_every_sample_and_every_strange_thing_is_in_the_figures() -> None:
    account = Account()
    account.expect(10)
    account.receive(6)
    account.miss(2, "no answer")
    account.drop(1, "checksum")
    account.count("restarts", 3)
    account.anomaly("malformed", 2)
    account.forgery("contradicting answers")
    figures = account.snapshot()
    assert figures["residue"] == account.residue == 1
    assert (figures["missed"], figures["dropped"]) == ({"no answer": 2}, {"checksum": 1})
    assert figures["counters"] == {"restarts": 3, "malformed": 2, "contradicting answers": 1}
    assert (figures["anomalies"], figures["forgeries"]) == (["malformed"], ["contradicting answers"])
