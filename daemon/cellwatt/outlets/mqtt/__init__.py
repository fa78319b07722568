"""The cell over MQTT: plain JSON topics, or Sparkplug B.

outlet, settings               the outlet
link, session, outbox          a connection; what is sent over it, and when; what waits for the broker
plain, edge_node, payload      the two formats: JSON topics; Sparkplug's births and deaths, and its payloads
message                        one message
"""
