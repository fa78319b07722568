"""Logs of other programs: ROS 2 bags, MCAP files of any writer, LeRobot data sets; joints are known by name.

``opening`` reads them, ``recorded`` gives them as recordings, ``choice`` says which topic or episode is meant.
"""
