"""Sends alarms of the cell to people: by mail, webhook, ntfy and Home Assistant, each once."""
