"""Curves of any span out of a folder of recordings, seconds to months, never more points than asked for.

buckets      lowest and highest value of each channel in steps of time
gathering    the part of a recording that the page shows: buckets of its frames and predictions, intervals, alarms
level_file   the same in a file beside the recordings
following    reads a recording chunk by chunk, also while it is written
sources      a recording by its level file, or in memory
store        the sources of all recordings; makes level files
budget       the bytes that all level files may take
keeping      the thread that keeps them up to date
moments      short spans, from the frames themselves
telling      intervals and alarms of a span
curves       answers
"""

from cellwatt.outlets.page.levels.curves import Curves

__all__ = ["Curves"]
