"""The commands of `groundstation`."""
