"""Curves of any span out of a folder of recordings, seconds to months, never more points than asked for.

buckets      lowest and highest value of each channel in steps of time
gathering    the part of a recording that the page shows: buckets of its frames and predictions, intervals, alarms
level_file   the same in a file beside the recordings, and the bytes that all of them may take
following    reads a recording chunk by chunk, also while it is written
store        what is known of all recordings; makes level files
moments      short spans, from the frames themselves
telling      intervals and alarms of a span
curves       answers, and the thread that keeps level files up to date
"""

from cellwatt.outlets.page.levels.curves import Curves

__all__ = ["Curves"]
