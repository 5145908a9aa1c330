"""The faults by name: how each strikes, when, and what can't be asked after it."""
