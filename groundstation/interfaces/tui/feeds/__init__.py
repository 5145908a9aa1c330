"""Where a dashboard's pictures come from: a running flight or a recording."""
