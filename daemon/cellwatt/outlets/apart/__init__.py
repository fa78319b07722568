"""Outlets that serve from a separate process, so that clients cannot slow down the daemon.

wire    starts the process with a socket to it, and stops it; messages through the socket
outlet  the daemon's side: queues, orders from people, heartbeats
daemon  the process' side: messages received, messages sent, orders
"""
