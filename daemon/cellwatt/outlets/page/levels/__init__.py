"""Curves of any span, seconds to months, from a folder of recordings, with at most the requested number of points.

buckets      lowest and highest value of each channel in steps of time
gathering    the digest of a recording: buckets of its frames and predictions, intervals, alarms
level_file   a digest in a file beside the recordings
following    reads the chunks of recordings, also while they are written
store        the data of all recordings; the thread that updates the level files
episodes     intervals and alarms of a span, the alarms from raise to clear
curves       curves of a span
"""
