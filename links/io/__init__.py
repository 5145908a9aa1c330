"""What the links open: sockets' addresses, serial ports, key files, shared memory."""
