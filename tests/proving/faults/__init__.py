"""The fault deck: one thing is broken in every state of a mission."""
