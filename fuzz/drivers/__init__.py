"""Targets that read what devices send: see docs/fuzzing.md."""
