"""Protection of every port that strangers reach: page, metrics, OPC UA, Foxglove.

settings  address, certificate, access
port      a listening port with limits: connections per peer and in total, deadlines
http      an HTTP application behind such a port
tries     failed logins: delay of further attempts
"""
