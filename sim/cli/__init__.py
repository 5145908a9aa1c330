"""The commands of `groundstation-sim`."""
