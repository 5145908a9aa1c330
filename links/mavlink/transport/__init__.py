"""What carries MAVLink: UDP, TCP or a serial port, opened again when it is lost."""
