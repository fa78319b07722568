"""Motions that would tell what the recordings cannot."""
