"""What a process of ours needs of its machine: clocks, sockets' places, locks, exit codes."""
