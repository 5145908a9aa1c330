"""What is said in MAVLink, sans-IO: codec, signing, time, heartbeat and status of an autopilot."""
