"""The MAVLink link to PX4 and ArduPilot: codec, connection, status, and the link itself."""
