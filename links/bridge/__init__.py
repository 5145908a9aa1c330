"""The RF bridge: the pacer and the module on another computer, and the link to it."""
