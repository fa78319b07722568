"""What makes a term leave."""

from types import SimpleNamespace

from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.backward import _as_blow
from cellwatt_plugins.robot.effects import BY_NAME


def test_a_push_on_a_joint_with_play_is_as_well_a_blow_in_it():
    contact = BY_NAME["external_contact"]
    play, own, other = Term(BY_NAME["backlash"], 1, ()), Term(contact, 1, ()), Term(contact, 0, ())
    now = SimpleNamespace(terms=[play, own, other])
    assert _as_blow(now, own)
    assert not _as_blow(now, other)
    assert not _as_blow(now, play)
