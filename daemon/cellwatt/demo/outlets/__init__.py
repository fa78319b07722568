"""The demo's cell in Prometheus, MQTT and OPC UA at once, read back with their clients and held side by side."""
