"""Whole cycles judged by physics: which joint's motion explains the power that healthy cycles do not have."""
