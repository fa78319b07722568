"""Judges whole cycles by physics: finds the joint whose motion explains the difference from healthy power."""
