"""What refuses or ends a flight: guards, geofence, separation, evidence against the poses, take-off and touchdown."""
