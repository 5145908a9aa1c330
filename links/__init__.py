"""Command links: how thrust and body rates leave for a vehicle, and that they stop when nobody commands."""
