"""Power meters that publish JSON over MQTT."""

from mqtt_meter.driver import MqttMeterDriver, MqttMeterSettings

__all__ = ["MqttMeterDriver", "MqttMeterSettings"]
