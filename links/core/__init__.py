"""What every link shares, sans-IO: the port, the dead man's switch, the thrust curve."""
