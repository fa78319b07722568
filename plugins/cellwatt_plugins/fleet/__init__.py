"""Many cells over many weeks: which ones drift, which joints wear, and what all arms of a kind have in common.

``lake`` finds the recordings, ``weekly`` makes a week of a cell into numbers, ``adjusted`` takes out programs and
temperature, ``courses`` follows them over the weeks, ``kinds`` and ``slopes`` compare arms, and ``judge`` says what is
sure.
"""
