"""The ways out of a cell: one folder each, and what they share.

selection      the rows that an outlet sends
cursor, past   the rows owed to a peer, and their reading from the record
forward        an outlet that only pushes: order, repetition, back-fill, account
remote         servers: trusted authorities, reasons of failures, pauses
apart          outlets that serve from a process of their own
"""
