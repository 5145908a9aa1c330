"""False alarms: true flights with the monitor of the poses armed."""
