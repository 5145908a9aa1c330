"""The mission as a table: state and event to state."""
