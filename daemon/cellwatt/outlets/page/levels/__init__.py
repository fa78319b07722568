"""Curves of any span out of a folder of recordings, seconds to months, never more points than asked for.

buckets      lowest and highest value of each channel in steps of time
gathering    the digest of a recording: buckets of its frames and predictions, intervals, alarms
level_file   a digest in a file beside the recordings
following    reads the chunks of recordings, also while they are written
store        what is known of all recordings; the thread that keeps level files up to date
episodes     intervals and alarms of a span, the alarms from raise to clear
curves       curves of a span
"""
