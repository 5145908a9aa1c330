"""An autopilot's parameters: looked at, advised on, and set one by one."""
