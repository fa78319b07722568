"""The cell over MQTT: plain JSON topics, or Sparkplug B."""
