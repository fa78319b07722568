"""Everything that strangers reach goes through a door: page, metrics, OPC UA, Foxglove.

settings  address, certificate, who may come in
port      a listening port with bounds: connections of a peer and in all, deadlines
http      an HTTP application behind such a port
tries     wrong passwords: who has to wait, and for how long
"""
