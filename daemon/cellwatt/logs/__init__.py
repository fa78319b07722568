"""Logs of other programs: ROS 2 bags, MCAP files of any writer, LeRobot data sets; joints are identified by name.

``opening`` reads logs, ``recorded`` converts them to recordings, ``choice`` selects a topic or an episode.
"""
