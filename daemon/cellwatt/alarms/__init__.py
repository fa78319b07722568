"""Alarms with patience, damping, acknowledgement and shelf.

standing  the state of one alarm; what a person and an evidence pack change
book      decides: raises, updates and clears alarms
followed  follows the book of another process by its messages, events and health
"""

from cellwatt.alarms.book import AT_ONCE, AlarmBook, Damping, withdrawn
from cellwatt.alarms.followed import LOST, RESTARTED, FollowedAlarms
from cellwatt.alarms.standing import SEVERITIES, WORDS, Acknowledgement, Patience, Shelf, Standing

__all__ = [
    "AT_ONCE",
    "LOST",
    "RESTARTED",
    "SEVERITIES",
    "WORDS",
    "Acknowledgement",
    "AlarmBook",
    "Damping",
    "FollowedAlarms",
    "Patience",
    "Shelf",
    "Standing",
    "withdrawn",
]
