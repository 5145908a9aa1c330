"""The dashboard: a process of its own."""
