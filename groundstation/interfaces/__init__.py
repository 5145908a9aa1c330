"""Access of people and programs to a flight: command line, sockets, MQTT, service, dashboard."""
