"""How people and programs reach a flight: command line, sockets, MQTT, service, dashboard."""
