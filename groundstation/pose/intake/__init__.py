"""What every pose source shares: checks, clocks, datagrams, playback."""
