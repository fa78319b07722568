"""Outlets that serve from a process of their own, which must not hold up the daemon.

wire    that process, begun with a socket to it and ended in order; messages through the socket
outlet  the daemon's side: queues, orders of people, signs of life
daemon  the side of the process: what it hears, says and asks
"""
